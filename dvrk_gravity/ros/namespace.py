"""The namespace of an arm's topics."""

from __future__ import annotations

import re

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.resources import shipped


def namespace_of(arm: Arm, given: str | None = None) -> str:
    """Return the namespace that was given, or that an arm has unless one is: ``/MTMR`` of mtmr.

    Raises:
        ConfigError: One that ROS does not take, or another arm's.
    """
    by_name = re.sub(r"\W", "_", arm.name.upper(), flags=re.ASCII)
    namespace = f"/{(given or re.sub(r'^(?=[0-9])', '_', by_name)).strip('/')}"
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        raise ConfigError("--namespace", namespace, "a ROS namespace, as /MTMR") from error
    require_own(arm, namespace)
    return namespace


def require_own(arm: Arm, namespace: str) -> None:
    """Refuse a namespace that names another arm of a da Vinci than the one that is commanded.

    Its limits are another arm's: a left master driven as a right one passes its stops by 73 deg.
    What other arms are called says nothing, nor does a namespace that names no arm.

    Raises:
        ConfigError: Such a namespace.
    """
    kinds = shipped("arms")
    last = namespace.rsplit("/", 1)[-1].lower()
    named = last if last in kinds else re.sub(r"[0-9]+$", "", last)  # PSM1, PSM2
    own = arm.name.lower()
    if own in kinds and named in kinds and named != own:
        raise ConfigError(
            "namespace", namespace, f"that of arm {own}, as /{own.upper()}: another arm's limits "
            "and model do not hold for it",
        )  # fmt: skip
