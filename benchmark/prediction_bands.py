"""How often a torque that an identified model has not seen lies within the band that it predicts.

    python benchmark/prediction_bands.py --seeds 0 5

Every seed draws an arm of MuJoCo's (testing/mujoco_world.py), records a calibration motion,
identifies it, and then records other motions of the same arm with nothing hidden. A model says of
every sample how far off it may be: its parameters' posterior, what it says outside the range that
it was identified on, and its known error; the band is 1.96 of their joint standard deviation.
Counted is the share of the usable samples within it, below 8 Hz, by joint; of motions within the
range and of others apart. Counted as well are the joints whose RMSE over a motion lies within the
band that `evaluate` prints.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from dvrk_gravity.diagnosis import FilteredData, load
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import evaluate
from testing.clean_motions import clean_motions, of_each_arm
from testing.hidden_parts import Hidden
from testing.score import OUTSIDE, outside


def shares(name: str, seed: int) -> list[tuple[bool, list[float], list[tuple[float, bool]]]]:
    """Return of each motion whether it goes outside, and two lists by joint.

    The share of its samples within their band, and RMSE over its expectation and whether it is
    within its own.
    """
    found = []
    for model, recording in clean_motions(name, seed, np.random.default_rng([seed, 0])):
        data = FilteredData.of(load([recording], model))
        variance = np.sum(data.model_columns**2, axis=2) + data.known_error**2
        within = np.abs(data.residual) <= NORMAL_95 * np.sqrt(variance)
        share = [
            float(np.mean(column[use])) for column, use in zip(within.T, data.usable.T, strict=True)
        ]
        beyond = outside(recording, Hidden("nothing", (), {}), model)
        judged = evaluate(model, recording)
        whole = [
            (rmse / band.rmse, band.low <= rmse <= band.high)
            for name, band in judged.expected.items()
            for rmse in [judged.joints[name].rmse]
        ]
        found.append((beyond >= OUTSIDE, share, whole))
    return found


def main(given: Sequence[str] | None = None) -> int:
    """Print the table."""
    groups: dict[bool, list[float]] = {False: [], True: []}
    wholes: dict[bool, list[tuple[float, bool]]] = {False: [], True: []}
    for name, seed, motions in of_each_arm(shares, __doc__, given):
        for beyond, share, whole in motions:
            groups[beyond] += share
            wholes[beyond] += whole
            told = " ".join(f"{100 * part:.0f}" for part in share)
            where = "outside the range" if beyond else "within the range"
            print(f"{name} {seed}, {where}: {told} % by joint", flush=True)
    for beyond, share in groups.items():
        if share:
            where = "outside" if beyond else "within"
            low, high = 100 * np.percentile(share, [5, 95])
            print(
                f"motions {where} the calibrated range: {100 * np.mean(share):.1f} % of samples "
                f"within the 95 % band ({len(share)} joints; 5 % of them below {low:.0f} %, "
                f"5 % above {high:.0f} %)"
            )
            ratio, inside = (np.array(values) for values in zip(*wholes[beyond], strict=True))
            print(
                f"RMSE of {len(ratio)} joints over what the model expects: median "
                f"{np.median(ratio):.2f}, standard deviation of its logarithm "
                f"{np.std(np.log(ratio)):.2f}; {100 * np.mean(inside):.0f} % within the 95 % band"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
