"""An arm without the joints of its file that lie beyond all that was recorded: fingers, a rail."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dvrk_gravity.arms import Arm, beyond, is_mtm
from dvrk_gravity.identification.motion import Source, all_static
from dvrk_gravity.recording import Recording, RecordingFile, opened


def held_beyond(
    recordings: Iterable[Source], arm: Arm, still: Mapping[str, float]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return where joints stood, those that no recording holds too, and a line about them.

    Joints beyond all that were recorded are taken to be held at zero, or at the limit next to it.
    An MTM's recording has all seven joints; there, one that is missing is a mistake.
    """
    seen = _recorded(recordings)
    missing = [joint for joint in arm.joint_names if joint not in (*seen, *still)]
    if not missing or is_mtm(arm):
        return dict(still), ()
    # A joint that it is said of where it stood may itself be carried by one that is beyond.
    where = beyond(arm, seen) or beyond(arm, (*seen, *still)) or {}
    where = {name: position for name, position in where.items() if name in missing}
    if not where:
        return dict(still), ()
    line = f"not recorded, and taken to be held (rad, m): {_shown(where)}"
    return {**still, **where}, (line,)


def with_held(
    recordings: Sequence[Recording | RecordingFile], arm: Arm, still: Mapping[str, float]
) -> tuple[Arm, list[Recording | RecordingFile], tuple[str, ...]]:
    """Return the arm without the joints that lie beyond all that was recorded, and who they are.

    They stand where it was said, or at zero. Of poses, neither has it any other joint of which only
    is known where it stood: nothing of them moved.
    """
    stood, lines = held_beyond(recordings, arm, still)
    held = {name: at for name, at in stood.items() if name not in still}
    if still and not is_mtm(arm):
        seen = _recorded(recordings)
        ends = still if all_static(recordings) else beyond(arm, seen) or ()
        said = {name: at for name, at in still.items() if name in ends and name not in seen}
        held |= said
        lines += (f"held where it was said (rad, m): {_shown(said)}",) if said else ()
    if not held:
        return arm, list(recordings), ()
    arm = arm.holding(held)
    told = tuple(f"{line}: no joints of the model" for line in lines)
    return arm, opened(recordings, arm=arm), told


def _recorded(recordings: Iterable[Source]) -> tuple[str, ...]:
    return tuple({joint for recording in recordings for joint in recording.head.joints})


def _shown(where: Mapping[str, float]) -> str:
    return ", ".join(f"{name} at {position:g}" for name, position in where.items())
