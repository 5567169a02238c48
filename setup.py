"""Build as an ament_python package: `colcon build`, or `pip install .` without ROS's tools."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "dvrk_gravity"

# `ros2 run dvrk_gravity VERB`; the same verbs as `python -m dvrk_gravity VERB`.
EXECUTABLES = (
    "compensator", "simulator", "watchdog", "plan", "collect", "calibrate", "excite", "replay",
    "convert", "identify", "evaluate", "diagnose", "demo", "newton-euler",
)  # fmt: skip

VERSION = re.search(r'__version__ = "(.+)"', Path(NAME, "__init__.py").read_text())[1]


def shared_files():
    """Install package.xml, the resource marker, launch files and configuration under share/."""
    files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ]
    for folder in ("config", "launch"):
        for path in sorted(Path(folder).rglob("*")):
            if path.is_file() and path.suffix in (".yaml", ".py", ".xml"):
                files.append((f"share/{NAME}/{path.parent}", [str(path)]))
    return files


setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "*/__init__.pyi", "ros/parameters/*.txt"]},
    data_files=shared_files(),
    python_requires=">=3.11",
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "clarabel>=0.9",
        "pin>=3.3",
        "pyyaml>=6.0",
        "rosbags>=0.10",
        "lz4>=4.0",
        "backports.zstd>=1.0",
        "matplotlib>=3.6",
        "jinja2>=3.0",
    ],
    extras_require={
        "test": [
            "pytest>=7.4",
            "pytest-xdist>=3.5",
            "hypothesis>=6.90",
            "mujoco>=4.0",
            "sympy>=1.12",
            "example-robot-data>=4.0",
            "xacrodoc>=2.0",
        ],
        "xacro": ["xacrodoc>=2.0"],  # expands URDFs that xacro has yet to
    },
    zip_safe=False,
    maintainer="dvrk_gravity maintainers",
    maintainer_email="maintainers@example.org",
    description="Gravity compensation of the dVRK's master arms, and why it is not perfect",
    license="BSD-3-Clause",
    entry_points={
        "console_scripts": [
            f"{verb} = {NAME}.command_line:executables.{verb.replace('-', '_')}"
            for verb in EXECUTABLES
        ],
    },
)
