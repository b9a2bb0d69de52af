# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

NAME = "mwd_estimation"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["numpy", "scipy", "welleng"],
    zip_safe=False,
    maintainer="MWD telemetry maintainers",
    maintainer_email="maintainers@mwd-telemetry.example",
    description="What the tool knows: gravity while drilling, attitude, north, interference, quality, uncertainty.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["estimator = mwd_estimation.nodes.estimator:main"]},
)
