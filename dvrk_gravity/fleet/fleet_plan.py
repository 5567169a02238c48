"""The units of work that a manifest and the results so far leave to be done."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from dvrk_gravity.fleet import remote
from dvrk_gravity.fleet.dates import date_in, date_of
from dvrk_gravity.fleet.manifest import ArmEntry, Manifest, is_url
from dvrk_gravity.fleet.store import Store
from dvrk_gravity.fleet.worker import Unit, model_hash

_BEGINNING = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass
class FleetPlan:
    """What is to be done of a fleet.

    Attributes:
        units: Of each arm, its recordings in the order of their dates.
        store: The results so far.
        skipped: Recordings whose results are there.
    """

    units: dict[str, list[Unit]]
    store: Store
    skipped: int = 0
    _models: dict[str, tuple[str, str]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, manifest: Manifest, store: Store, report: Callable[[int], None] = lambda arms: None
    ) -> FleetPlan:
        """Look at every recording of a manifest: name, size and date, and no more.

        Args:
            manifest: The arms.
            store: The results so far.
            report: Called with the number of arms looked at.

        Raises:
            ConfigError: A pattern without recordings, or a model that is out of reach.
        """
        planned = cls({}, store)
        for count, arm in enumerate(manifest.arms, start=1):
            units = [_unit(arm, name) for name in arm.files()]
            planned.units[arm.serial] = sorted(units, key=lambda each: (each.date, each.recording))
            if arm.model:
                planned.set_model(arm.serial, arm.model)
            elif store.model(arm.serial).exists():
                planned.set_model(arm.serial, str(store.model(arm.serial)))
            report(count)
        return planned

    @property
    def total(self) -> int:
        """Recordings of all arms."""
        return sum(map(len, self.units.values()))

    def set_model(self, serial: str, path: str) -> None:
        """Compare an arm's recordings with a model from now on."""
        self._models[serial] = path, model_hash(path)

    def references(self) -> Iterator[tuple[str, deque[Unit]]]:
        """Yield the arms without a model, with the recordings that may be identified for one.

        Those that could not be, in an earlier run, could not now.
        """
        for serial, units in self.units.items():
            if serial not in self._models:
                yield serial, deque(unit for unit in units if not self.store.has(unit))

    def pending_comparisons(self) -> Iterator[Unit]:
        """Yield recordings still to be compared with a model, arm by arm."""
        for serial, units in self.units.items():
            if serial not in self._models:
                continue
            path, its = self._models[serial]
            known = self.store.contents(serial, its)
            for unit in units:
                whole = replace(unit, model=path, model_hash=its, known=known)
                if self.store.has(whole):
                    self.skipped += 1
                else:
                    yield whole


def _unit(arm: ArmEntry, name: str) -> Unit:
    if is_url(name):
        size, modified = remote.file_info(name)
        named = date_in(name)
        date = named or modified or _BEGINNING
        stamp = int(modified.timestamp() * 1e9) if modified else 0
        came = "name" if named else "modified"
    else:
        path = Path(name)
        parts = [each for each in path.rglob("*") if each.is_file()] if path.is_dir() else [path]
        stats = [each.stat() for each in parts]
        size, stamp = sum(each.st_size for each in stats), max(each.st_mtime_ns for each in stats)
        date, came = date_of(path)
    return Unit(arm.arm, arm.serial, name, date.isoformat(), came, size, stamp, arm.topic)
