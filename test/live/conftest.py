"""Live tests: real nodes over DDS, one at a time, in a ROS domain that nobody else uses."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from arm_side import FakeArm
from support import REPOSITORY


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let processes see Ctrl-C even where a shell runs the tests in the background, ignoring it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def quick_discovery() -> Iterator[None]:
    """Let nodes that were not heard at first announce themselves again after 0.1 s, not 3 s."""
    from dvrk_gravity.ros import ENVIRONMENT

    with pytest.MonkeyPatch.context() as patch:
        profile = REPOSITORY / "test" / "live" / "discovery.xml"
        patch.setitem(ENVIRONMENT, "FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        yield


@pytest.fixture
def domain() -> Iterator[int]:
    """Return a ROS domain that no other test, demo or benchmark uses at the same time."""
    from dvrk_gravity.ros import private_domain

    with private_domain() as number:
        yield number


@pytest.fixture
def arm(domain: int) -> Iterator[FakeArm]:
    """Return the arm's side of the compensator's topics."""
    with FakeArm() as fake:
        yield fake
