# SPDX-License-Identifier: Apache-2.0
from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "mwd_surface"
# Version and description are kept in package.xml only, because the release tools of ROS read and change them there.
ABOUT = ElementTree.parse("package.xml")  # noqa: S314  (our own file)
VERSION = ABOUT.findtext("version")

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(exclude=["test"]),
    package_data={
        NAME: [
            "page/static/*",
            "page/static/vendor/*",
            "runs/fastdds.xml",
            "ros/security_policy.yaml",
            "signals/table.csv",
            "language/*.po",
            "language/commands/*.po",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", [*glob("config/*"), "mwd_surface/runs/fastdds.xml"]),
    ],
    install_requires=[
        f"mwd_sensors=={VERSION}",
        f"mwd_estimation=={VERSION}",
        "cryptography",
        "numpy",
        "scipy",
        "PyYAML",
        "typer>=0.12.4",
        "rich",
        "aiohttp",
        "mcap",
        "rosbags",
        "zstandard",
        "lz4",
        "welleng",
        "matplotlib",
        "ezdxf",
        "lasio",
        "openpyxl",
        "lxml",
        "jinja2",
        "fpdf2",
        "pyarrow",
        "babel",
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
    description=ABOUT.findtext("description"),
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
