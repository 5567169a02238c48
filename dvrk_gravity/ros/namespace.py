"""The namespace of an arm's topics."""

from __future__ import annotations

import re

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError


def namespace_of(arm: Arm, given: str | None = None) -> str:
    """Return the namespace that was given, or that an arm has unless one is: ``/MTMR`` of mtmr.

    Raises:
        ConfigError: One that ROS does not take.
    """
    by_name = re.sub(r"\W", "_", arm.name.upper(), flags=re.ASCII)
    namespace = f"/{(given or re.sub(r'^(?=[0-9])', '_', by_name)).strip('/')}"
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        raise ConfigError("--namespace", namespace, "a ROS namespace, as /MTMR") from error
    return namespace
