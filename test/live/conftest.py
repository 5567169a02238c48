"""Live tests: real nodes over DDS, one at a time, in a ROS domain that nobody else uses."""

from live_nodes import arm, domain, driven, patience, quick_discovery, rig, start  # noqa: F401
