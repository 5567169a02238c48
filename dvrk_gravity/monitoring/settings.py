"""When a monitor reports something."""

from __future__ import annotations

from dataclasses import dataclass, field

from dvrk_gravity.monitoring.window import Sampling


@dataclass(frozen=True)
class MonitorSettings:
    """When a monitor reports something.

    Attributes:
        sampling: Of the observer and of the tests.
        false_alarms: An hour, of changes and of pushes, were the errors as the model knows them.
        spans: s, of last seconds with which something may have begun, the longest first: friction
            of twice the noise takes ten to twenty to show.
        window: s, of the rows that are kept: the longest span, and what serves to know the
            uncertain directions before it.
        min_history: s, of rows from which on they serve so.
        min_duration: s that a cause has lasted when it is named: in less, others look like it.
            Chosen.
        forgetting_time: s, after which a part 1/e of what is known of the directions is left:
            friction warms up in minutes.
        warm_up: s of motion, before which the directions are not known, and nothing is reported.
        min_relative_size: Torque of a change, in RMS of what the model is known to be off by, below
            which it is minor.
        margin: Twice the log-likelihood by which a cause must excel others: e^5 to one; and
        margin_fraction: of its own, since a cause's torque is known to some per cent.
        patience: s since its onset for which a cause that does not excel them is waited for.
        give_up: s, after which something that no cause explains is reported.
        level_delay: s, after which the size of errors counts as the arm's own, and not as a
            change's.
        longest_push: s, which the longest push lasts.
        misfit_limit: Mean square of whitened residuals beside a cause, from which on it does not
            explain them: 1.5 squared.
    """

    sampling: Sampling = field(default_factory=Sampling)
    false_alarms: float = 0.1
    spans: tuple[float, ...] = (24.0, 20.0, 16.0, *map(float, range(12, 1, -1)))
    window: float = 36.0
    min_history: float = 20.0
    min_duration: float = 4.0
    forgetting_time: float = 600.0
    warm_up: float = 10.0
    min_relative_size: float = 1.0
    margin: float = 10.0
    margin_fraction: float = 0.1
    patience: float = 7.0
    give_up: float = 10.0
    level_delay: float = 12.0
    longest_push: float = 5.0
    misfit_limit: float = 2.25
