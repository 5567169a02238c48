"""Build as an ament_python package with `colcon build`, or as a wheel with `pip install .`."""

import re
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "dvrk_gravity"

# `ros2 run dvrk_gravity VERB`; the same verbs as `python -m dvrk_gravity VERB`.
EXECUTABLES = (
    "compensator", "simulator", "watchdog", "monitor", "plan", "collect", "calibrate", "excite",
    "replay", "convert", "identify", "evaluate", "diagnose", "fleet", "history", "demo", "get",
    "set", "newton-euler",
)  # fmt: skip

# A wheel's executables share one folder with all others, where `convert` is ImageMagick's: there is
# but one, `dvrk_gravity VERB`.
IS_WHEEL = bool({"bdist_wheel", "dist_info", "editable_wheel"} & set(sys.argv))


def console_scripts():
    """Return the executables: one for each verb, of a wheel one for all."""
    if IS_WHEEL:
        return [f"{NAME} = {NAME}.__main__:main"]
    target = f"{NAME}.command_line:executables"
    return [f"{verb} = {target}.{verb.replace('-', '_')}" for verb in EXECUTABLES]


VERSION = re.search(r'__version__ = "(.+)"', Path(NAME, "__init__.py").read_text())[1]


def shared_files():
    """Install package.xml, the resource marker, launch files and configuration under share/."""
    files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ]
    for folder in ("config", "launch"):
        for path in sorted(Path(folder).rglob("*")):
            if path.is_file() and path.suffix in (".yaml", ".py", ".xml", ".json", ".rviz"):
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
        "numpy>=1.26",
        "scipy>=1.11",
        "clarabel>=0.9",
        "pin>=3.3",
        "pyyaml>=6.0",
        "rosbags>=0.10",
        "lz4>=4.0",
        "mcap>=1.2",
        "zstandard>=0.22",
        "matplotlib>=3.6",
    ],
    extras_require={
        "test": [
            "pytest>=7.4",
            "pytest-xdist>=3.5",
            "hypothesis>=6.90",
            "mujoco>=4.0",
            "sympy>=1.12",
            "example-robot-data>=4.0",
            "jupytext>=1.16",
            "pandas>=2.0",
            "websockets>=13",
            "xacrodoc>=2.0",
            "distributed>=2025.1",
            "pyarrow>=15",
            "fsspec>=2024.2",
        ],
        # Many arms, on Dask; results in Parquet, recordings behind URLs.
        "fleet": ["distributed>=2025.1", "pyarrow>=15", "fsspec>=2024.2"],
        "xacro": ["xacrodoc>=2.0"],  # expands URDFs that xacro has yet to
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],  # without a ROS 2
    },
    zip_safe=False,
    maintainer="dvrk_gravity maintainers",
    maintainer_email="maintainers@example.org",
    description="Gravity compensation of the dVRK's arms and others, and why it is not perfect",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="BSD-3-Clause",
    license_files=["LICENSE"],
    keywords=[
        "robotics",
        "gravity compensation",
        "identification",
        "da Vinci Research Kit",
        "ROS 2",
    ],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering",
        "Typing :: Typed",
    ],
    entry_points={"console_scripts": console_scripts()},
)
