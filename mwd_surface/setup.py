# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

NAME = "mwd_surface"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={
        NAME: [
            "page/static/*",
            "page/static/vendor/*",
            "runs/fastdds.xml",
            "ros/security_policy.yaml",
            "signals/table.csv",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", [*glob("config/*"), "mwd_surface/runs/fastdds.xml"]),
    ],
    install_requires=[
        "cryptography",
        "numpy",
        "scipy",
        "PyYAML",
        "typer>=0.12.4",
        "rich",
        "aiohttp",
        "rosbags",
        "zstandard",
        "lz4",
        "welleng",
        "matplotlib",
        "lasio",
        "openpyxl",
        "lxml",
        "jinja2",
        "fpdf2",
        "pyarrow",
    ],
    extras_require={
        "opcua": ["asyncua"],
        "modbus": ["pymodbus>=3.13,<4"],
        "serial": ["pyserial"],
        "cluster": ["distributed"],
        "foxglove": ["foxglove-sdk"],
    },
    zip_safe=False,
    maintainer="MWD telemetry maintainers",
    maintainer_email="maintainers@mwd-telemetry.example",
    description="Recording, surveys, well path, live page, rig protocols, reports and the mwd command.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "surface = mwd_surface.nodes.surface:main",
            "receiver = mwd_surface.nodes.receiver:main",
            "well = mwd_surface.nodes.well:main",
            "replay = mwd_surface.nodes.replay:main",
            "mwd = mwd_surface.__main__:main",
        ]
    },
)
