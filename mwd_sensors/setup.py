# SPDX-License-Identifier: Apache-2.0
from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "mwd_sensors"
# Version and description are kept in package.xml only, because the release tools of ROS read and change them there.
ABOUT = ElementTree.parse("package.xml")  # noqa: S314  (our own file)
VERSION = ABOUT.findtext("version")

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["simulator/grades/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
        # A link to bags/scenarios, so that an installed graph has them too.
        (f"share/{NAME}/scenarios", glob("scenarios/*.yaml")),
        (f"share/{NAME}/scenarios/bench", glob("scenarios/bench/*.yaml")),
    ],
    install_requires=[
        "numpy",
        "scipy",
        "numba",
        "PyYAML",
        "pyproj",
        "pygeomag",
        "ppigrf",
        "pyserial",
        "pymodbus>=3.13,<4",
    ],
    zip_safe=False,
    maintainer="MWD telemetry maintainers",
    maintainer_email="maintainers@mwd-telemetry.example",
    description=ABOUT.findtext("description"),
    license="Apache-2.0",
    entry_points={"console_scripts": ["sonde = mwd_sensors.nodes.sonde:main", "probe = mwd_sensors.nodes.probe:main"]},
)
