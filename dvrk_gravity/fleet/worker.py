"""One recording and its arm's model to rows: all that a worker does, and it needs nothing else."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from dvrk_gravity import __version__
from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Diagnosis, diagnose, track
from dvrk_gravity.errors import ConfigError, DvrkGravityError, RecordingError
from dvrk_gravity.fleet import remote, rows
from dvrk_gravity.fleet.manifest import is_url
from dvrk_gravity.fleet.rows import Row
from dvrk_gravity.identification import Fit, evaluate, identify
from dvrk_gravity.model import TorqueModel, uncertainty_file
from dvrk_gravity.recording import Recording, load_excerpt

T = TypeVar("T")

_CHUNK = 1 << 20
_LENGTH = 20  # hexadecimal digits: 80 bits, so that a billion results agree by chance once in 1e6


@dataclass(frozen=True)
class Unit:
    """A recording to be worked on.

    Attributes:
        arm: Its kind, as of the manifest.
        serial: Which arm.
        recording: Path or URL.
        date: When it began, ISO 8601.
        date_from: Where that is from, one of ``dates.DateFrom``.
        size: Bytes.
        modified: ns since 1970; 0: not known.
        topic: JointState topic; ``""``: the only one.
        model: Path or URL of the arm's model; ``""``: the recording is identified for one.
        model_hash: Of that model's files; ``""`` without one.
        known: Hashes of the contents of the arm's recordings whose results are there already.
    """

    arm: str
    serial: str
    recording: str
    date: str
    date_from: str
    size: int
    modified: int
    topic: str = ""
    model: str = ""
    model_hash: str = ""
    known: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Result:
    """What became of a unit.

    Attributes:
        key: Of the result; see :func:`key_of`.
        known: The same content is done already, under another name: there is nothing else.
        table: Rows, as a Parquet file.
        report: HTML; ``""``: none.
        model: The model and its uncertainty, as files' contents, where it was identified for one.
        failures: What could not be done, a line each.
        verdict: Of the diagnosis; of the identification, where that is all.
        seconds: That it took.
    """

    key: str
    known: bool = False
    table: bytes = b""
    report: str = ""
    model: tuple[bytes, bytes] | None = None
    failures: tuple[str, ...] = ()
    verdict: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Pages:
    """What writes reports: this room does no rendering.

    Attributes:
        fit: Of an identification, with the recording's name.
        diagnosis: Of a diagnosis, likewise.
    """

    fit: Callable[[Fit, str], str]
    diagnosis: Callable[[Diagnosis, Sequence[str]], str]


def key_of(content: str, model: str, version: str = __version__) -> str:
    """Return the key of a result: of equal keys the results are equal."""
    return hashlib.sha256(f"{content} {model} {version}".encode()).hexdigest()[:_LENGTH]


def work(unit: Unit, pages: Pages | None = None) -> Result:
    """Identify, evaluate and diagnose a recording.

    What is wrong with the recording is in the result, as rows of kind ``failure``: it would be the
    same again. What is wrong with the machine is raised.

    Args:
        unit: The recording.
        pages: What writes its report; ``None``: none is written.

    Raises:
        OSError: The recording is out of reach.
        ConfigError: The model is not what the unit says.
    """
    begun = time.monotonic()
    with ExitStack() as stack:
        path = Path(unit.recording)
        if is_url(unit.recording):
            path = stack.enter_context(remote.fetch(unit.recording))
        content = content_hash(path)
        key = key_of(content, unit.model_hash)
        if content in unit.known:
            return Result(key, known=True)
        steps = _Steps(unit, path, pages)
        found, report, model = steps.reference() if not unit.model else steps.compare_with_model()
    seconds = time.monotonic() - begun
    whole = {
        "key": key, "arm": unit.arm, "serial": unit.serial, "recording": unit.recording,
        "date": datetime.fromisoformat(unit.date), "date_from": unit.date_from, "content": content,
        "model": unit.model_hash, "version": __version__, "size": unit.size,
        "modified": unit.modified, "seconds": seconds,
        "report": f"reports/{key}.html" if report else None,
    }  # fmt: skip
    if not any(row["kind"] == "recording" for row in found):
        found.append({"kind": "recording", "verdict": "failed", "text": steps.failures[0]})
    verdict = next(row["verdict"] for row in found if row["kind"] == "recording")
    table = rows.parquet({**whole, **row} for row in found)
    return Result(
        key, table=table, report=report, model=model, failures=tuple(steps.failures),
        verdict=verdict, seconds=seconds,
    )  # fmt: skip


def content_hash(path: Path) -> str:
    """Return a hash of a file's content, of a folder that of its files with their names."""
    files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
    whole = hashlib.sha256()
    for file in files:
        whole.update(f"{file.relative_to(path)} {file.stat().st_size}\n".encode() * path.is_dir())
        with file.open("rb") as stream:
            while block := stream.read(_CHUNK):
                whole.update(block)
    return whole.hexdigest()[:_LENGTH]


def model_hash(path: str) -> str:
    """Return a hash of a model's files, its uncertainty included.

    Raises:
        OSError: It is out of reach.
        RecordingError: Its URL is.
    """
    with _model_files(path) as files:
        return _hash_of(files)


def _hash_of(files: Sequence[Path]) -> str:
    whole = hashlib.sha256()
    for file in files:
        whole.update(file.read_bytes())
    return whole.hexdigest()[:_LENGTH]


@contextmanager
def _model_files(path: str) -> Iterator[list[Path]]:
    """Give a model's file and, if there is one, that of its uncertainty, with their names."""
    if not is_url(path):
        uncertainty_path = uncertainty_file(Path(path))
        yield [Path(path), *([uncertainty_path] if uncertainty_path.exists() else [])]
        return
    with remote.fetch(path) as file:
        uncertainty_path = uncertainty_file(file)
        url = f"{path.rpartition('/')[0]}/{uncertainty_path.name}"
        with suppress(RecordingError), remote.fetch(url) as its:
            uncertainty_path.write_bytes(its.read_bytes())
        yield [file, *([uncertainty_path] if uncertainty_path.exists() else [])]


@lru_cache(maxsize=16)
def _load_model(path: str, known: str) -> TorqueModel:
    """Return a model, as the hash knows it: many recordings of an arm follow each other."""
    with _model_files(path) as files:
        if _hash_of(files) != known:
            raise ConfigError("", "another model than when the run began", "the same one", path)
        return TorqueModel.load(files[0])


class _Steps:
    """The steps of one unit; what fails with a user's error is noted, and the others go on."""

    def __init__(self, unit: Unit, path: Path, pages: Pages | None) -> None:
        self._unit, self._path, self._pages = unit, path, pages
        self.failures = list[str]()
        self._rows = list[Row]()

    def reference(self) -> tuple[list[Row], str, tuple[bytes, bytes] | None]:
        """Return rows, report and model of a recording that is identified for its arm's model."""
        arm = Arm.load(self._unit.arm)
        fit = self._try("identify", lambda: identify(self._read(arm), arm))
        if fit is None:
            return self._rows, "", None
        verdict = f"reference, {fit.verdict.words}"
        self._rows += [{"kind": "recording", "verdict": "reference", "text": verdict}]
        self._rows += rows.fit_rows(fit)
        report = "" if self._pages is None else self._pages.fit(fit, self._unit.recording)
        with TemporaryDirectory(prefix="dvrk_gravity-") as folder:
            path = Path(folder, f"{self._unit.serial}.yaml")
            fit.model.save(path, f"Identified by dvrk_gravity fleet from {self._unit.recording}.")
            return self._rows, report, (path.read_bytes(), uncertainty_file(path).read_bytes())

    def compare_with_model(self) -> tuple[list[Row], str, None]:
        """Return rows and report of a recording beside its arm's model."""
        model = _load_model(self._unit.model, self._unit.model_hash)
        arm, report = model.arm, ""
        recording = self._try("read", lambda: self._read(arm))
        if recording is None:
            return self._rows, report, None
        diagnosis = self._try("diagnose", lambda: diagnose(recording, model))
        if diagnosis is not None:
            self._rows += rows.diagnosis_rows(diagnosis)
            if self._pages is not None:
                report = self._pages.diagnosis(diagnosis, [self._unit.recording])
        if (changes := self._try("track", lambda: track(recording, model))) is not None:
            self._rows += rows.change_rows(changes)
        units = dict(zip(arm.joint_names, arm.effort_units, strict=True))
        if (evaluation := self._try("evaluate", lambda: evaluate(model, recording))) is not None:
            self._rows += rows.evaluation_rows(evaluation, units)
        if (fit := self._try("identify", lambda: identify(recording, arm))) is not None:
            self._rows += rows.fit_rows(fit)
        return self._rows, report, None

    def _read(self, arm: Arm) -> Recording:
        return load_excerpt(self._path, topic=self._unit.topic or None, arm=arm)

    def _try(self, step: str, call: Callable[[], T]) -> T | None:
        try:
            return call()
        except DvrkGravityError as error:
            text = str(error).replace(str(self._path), self._unit.recording)
            self.failures.append(text)
            self._rows.append({"kind": "failure", "effect": step, "text": text})
            return None
