"""An arm without the joints of its file that lie beyond all that was recorded: fingers, a rail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.held import beyond
from dvrk_gravity.arms.mtm import is_mtm
from dvrk_gravity.identification.evaluation import all_static
from dvrk_gravity.identification.motion import held_beyond
from dvrk_gravity.recording import Recording, RecordingFile, opened


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
        seen = tuple({joint for recording in recordings for joint in recording.head.joints})
        ends = still if all_static(recordings) else beyond(arm, seen) or ()
        said = {name: at for name, at in still.items() if name in ends and name not in seen}
        shown = ", ".join(f"{name} at {at:g}" for name, at in said.items())
        held |= said
        lines += (f"held where it was said (rad, m): {shown}",) if said else ()
    if not held:
        return arm, list(recordings), ()
    arm = arm.holding(held)
    told = tuple(f"{line}: no joints of the model" for line in lines)
    return arm, opened(recordings, arm=arm), told
