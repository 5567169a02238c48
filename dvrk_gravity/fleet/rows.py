"""What a recording amounts to, as rows of one table: Parquet, one schema for all kinds of rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal

from dvrk_gravity.diagnosis import Diagnosis, TrackedChange
from dvrk_gravity.effects import Estimate
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import Evaluation, Fit

if TYPE_CHECKING:
    import pyarrow

Row = dict[str, Any]
Kind = Literal["recording", "failure", "error", "finding", "parameter", "change"]
"""``recording``: the diagnosis as a whole, one a result; ``failure``: a step that could not be
done, and why; ``error``: the model's error at a joint; ``finding``: a parameter of a finding;
``parameter``: one of the recording's own identification; ``change``: a change fitted alone."""

# Name -> Arrow type, meaning: docs/fleet.md has this table.
COLUMNS: Mapping[str, tuple[str, str]] = {
    "key": ("string", "of the result: hash of `content`, `model` and `version`"),
    "kind": ("string", "recording, failure, error, finding, parameter or change"),
    "arm": ("string", "kind of arm: `mtmr`, `psm`, or the name in its file"),
    "serial": ("string", "which arm"),
    "recording": ("string", "path or URL"),
    "date": ("timestamp", "when the recording began, UTC"),
    "date_from": ("string", "bag, time column, name or modified"),
    "effect": ("string", "name of the effect (findings and changes), term, or verb that failed"),
    "joints": ("string", "joints, comma-separated; empty: the arm"),
    "parameter": ("string", "name of the parameter"),
    "value": ("double", "SI; of a change: by how much it differs from the model"),
    "standard_error": ("double", "of `value`; a quarter of the 95 % interval's width where uneven"),
    "low": ("double", "lower end of the 95 % interval"),
    "high": ("double", "upper end"),
    "unit": ("string", "SI unit"),
    "verdict": ("string", "of the diagnosis; of a parameter's row: of the identification"),
    "certainty": ("string", "of a finding: certain or perhaps; of a parameter: data or prior"),
    "torque_ratio": ("double", "RMS torque of a unit change over the model's RMS friction"),
    "p_value": ("double", "of a finding's gain on held-out blocks"),
    "text": ("string", "the finding, the verdict or the failure in a sentence"),
    "report": ("string", "path of the recording's report, as seen from the folder of results"),
    "content": ("string", "hash of the recording's content"),
    "model": ("string", "hash of the model; empty: the recording was identified for one"),
    "version": ("string", "of this package"),
    "size": ("int64", "bytes of the recording"),
    "modified": ("int64", "when it was last modified, ns since 1970"),
    "seconds": ("double", "what the recording took a worker"),
}
_WIDTH = 2.0 * NORMAL_95


def schema() -> pyarrow.Schema:
    """Return the table's schema."""
    import pyarrow as pa

    types = {
        "string": pa.string(), "double": pa.float64(), "int64": pa.int64(),
        "timestamp": pa.timestamp("us", tz="UTC"),
    }  # fmt: skip
    return pa.schema([(name, types[kind]) for name, (kind, _) in COLUMNS.items()])


def parquet(rows: Iterable[Row]) -> bytes:
    """Return rows as a Parquet file; what a row lacks is null."""
    import pyarrow as pa
    from pyarrow import parquet as files

    stream = BytesIO()
    table = pa.Table.from_pylist(list(rows), schema())
    files.write_table(table, stream, compression="zstd")
    return stream.getvalue()


def fit_rows(fit: Fit) -> Iterator[Row]:
    """Yield the parameters of an identification."""
    for each in fit.parameters:
        term, _, joint = each.name.partition("[")
        low, high = map(float, each.ci95)
        yield {
            "kind": "parameter", "effect": term.partition(".")[0],
            "joints": joint.partition("]")[0],
            "parameter": each.name, "verdict": fit.verdict.level,
            "certainty": "data" if each.identifiable else "prior",
            **_interval(Estimate(each.value, low, high, each.unit)),
        }  # fmt: skip


def evaluation_rows(result: Evaluation, units: Mapping[str, str]) -> Iterator[Row]:
    """Yield the error of a model at each joint: rmse and floor, and the first over the torque."""
    for joint, error in result.joints.items():
        sizes = {"rmse": (error.rmse, units[joint]), "nrmse": (error.nrmse, ""),
                 "floor": (error.floor, units[joint])}  # fmt: skip
        for name, (value, unit) in sizes.items():
            yield {
                "kind": "error",
                "joints": joint,
                "parameter": name,
                "value": value,
                "unit": unit,
            }


def diagnosis_rows(diagnosis: Diagnosis) -> Iterator[Row]:
    """Yield the verdict, and the parameters of every finding."""
    yield {"kind": "recording", "verdict": diagnosis.verdict, "text": diagnosis.sentence}
    for finding in diagnosis.findings:
        whole = {
            "kind": "finding", "effect": finding.effect, "joints": ",".join(finding.joints),
            "verdict": diagnosis.verdict, "certainty": "certain" if finding.certain else "perhaps",
            "p_value": finding.gain.p_value, "text": finding.sentence,
        }  # fmt: skip
        for name, estimate in finding.parameters.items():
            yield {**whole, "parameter": name, **_interval(estimate)}
        if not finding.parameters:
            yield whole


def change_rows(changes: Iterable[TrackedChange]) -> Iterator[Row]:
    """Yield the changes that were fitted alone."""
    for each in changes:
        half = NORMAL_95 * each.error
        yield {
            "kind": "change", "effect": each.effect, "joints": each.joint,
            "parameter": each.parameter, "value": each.value, "standard_error": each.error,
            "low": each.value - half, "high": each.value + half, "unit": each.unit,
            "torque_ratio": each.torque_ratio,
        }  # fmt: skip


def _interval(estimate: Estimate) -> Row:
    return {
        "value": estimate.value, "standard_error": (estimate.high - estimate.low) / _WIDTH,
        "low": estimate.low, "high": estimate.high, "unit": estimate.unit,
    }  # fmt: skip
