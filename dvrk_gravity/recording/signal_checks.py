"""Checks of the signals: stale and jittering samples, saturation, quantisation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning, Kind
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.grid import speed, split_at_gaps, stale
from dvrk_gravity.recording.quantization import quantum, velocity_error
from dvrk_gravity.recording.sample_times import retimed


@dataclass(frozen=True)
class SignalSettings:
    """When signals are worse than they seem.

    Attributes:
        stale: Part of the samples that repeat the one before while the arm moves. Chosen.
        read_jitter: Way of samples off their stamps, RMS in sampling intervals. Chosen.
        coarse_position: One encoder step a sample, as a part of the joint's RMS velocity. Chosen.
        coarse_velocity: Error of the derived velocity below ``step_band``, likewise: at 200 Hz that
            of ``coarse_position``. In faster samples a step is a larger velocity, and the error in
            the band is none the greater.
        step_band: Hz, that motion is looked at below (``diagnosis.load``).
        coarse: One step, as a part of the signal's standard deviation. Chosen.
        pinned_run: Equal extreme readings in a row, while the joint moves. Chosen.
        pinned_share: Part of static poses with the same extreme effort. Chosen.
        ripple: Part of the torque that ripple puts into what is fitted. Real recordings (MTM, PSM,
            UR10e) have 0.000 to 0.005, simulated ones without steps 0.000 to 0.004
            (`Multisine.draw`, seeds 0 to 7, at 100, 200, 1000 Hz); a stiff servo that follows steps
            at 50 to 500 Hz leaves 0.03 to 0.15 at 200 Hz, 0.01 to 0.04 at 1 kHz (seeds 1 to 4 of
            `stepped` in test/test_set_points.py).
        ripple_band: Hz, what is fitted: ``prepare.DEFAULT_CUTOFF``.
        slowest: Velocity below which a joint shows no jitter, rad/s. Chosen: rounding.
    """

    stale: float = 0.01
    read_jitter: float = 0.2
    coarse_position: float = 0.1
    coarse_velocity: float = 0.0047
    step_band: float = 20.0
    coarse: float = 0.05
    pinned_run: int = 5
    pinned_share: float = 0.02
    ripple: float = 0.01
    ripple_band: float = 5.65
    slowest: float = 1e-6


def _longest_run(mask: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def sampling(recording: Recording) -> list[DataWarning]:
    """Return findings about stale samples and samples taken off their stamps."""
    findings, settings = [], SignalSettings()
    old = stale(recording)
    if np.mean(old) > settings.stale:
        longest = _longest_run(old)
        findings.append(
            DataWarning(
                "stale_samples",
                None,
                {"samples": int(old.sum()), "share": float(np.mean(old)), "longest": longest},
                f"{old.sum()} of {len(recording)} samples repeat the one before while the arm "
                f"moves, up to {longest} in a row",
            )
        )
    # Over a gap nothing is smooth.
    jitter = read_jitter(max(split_at_gaps(recording), key=len))
    rate = recording.rate
    fresh = max(split_at_gaps(recording.rows(~old)), key=len)
    corrected = rate is not None and retimed(fresh) is not fresh
    if (
        jitter is not None
        and rate is not None
        and (corrected or jitter * rate > settings.read_jitter)
    ):
        findings.append(
            DataWarning(
                "read_jitter",
                None,
                {"jitter_s": jitter, "interval_s": 1.0 / rate, "corrected": float(corrected)},
                f"samples were taken about {1e3 * jitter:.2g} ms off their stamps, stale ones "
                f"included (interval {1e3 / rate:.3g} ms)"
                + ("; put back to when positions and velocities agree" if corrected else ""),
            )
        )
    return findings


def read_jitter(recording: Recording) -> float | None:
    """Return how far samples lie off their stamps, RMS in s, or ``None`` if the data cannot tell.

    A sample that is taken ``dt`` off its stamp is wrong by velocity times ``dt``: what the position
    has above a tenth of the sampling rate grows with speed, while noise and quantisation do not.
    The slope of its square against squared velocity is the squared jitter; the median over the
    joints is returned.
    """
    rate = recording.rate
    if rate is None or len(recording) < 200:
        return None
    rough = recording.position - LowPass(rate / 10.0, rate)(recording.position)
    inner = slice(20, -20)
    squared_speed = speed(recording)[inner] ** 2
    slopes, slowest = [], SignalSettings().slowest
    for error, squared in zip((rough[inner] ** 2).T, squared_speed.T, strict=True):
        if np.ptp(squared) > slowest**2:
            columns = np.column_stack([np.ones_like(squared), squared / squared.max()])
            slopes.append(np.linalg.lstsq(columns, error, rcond=None)[0][1] / squared.max())
    return float(np.sqrt(max(np.median(slopes), 0.0))) if slopes else None


def ripple(recording: Recording) -> list[DataWarning]:
    """Return a finding where efforts ripple with the motion faster than the recording can follow.

    A position servo answers every step of its commands with a blow of torque. Blows faster than
    half the sampling rate turn up anywhere below it: as much in the band that is fitted as in one
    equally wide above, for all that is known. Commands in exact step with the samples would show no
    ripple and yet do the same harm; clocks of two programs are never so exact.
    """
    share, settings = effort_ripple(recording), SignalSettings()
    if share is None or share <= settings.ripple or recording.rate is None:
        return []
    return [
        DataWarning(
            "effort_ripple",
            None,
            {"share": share, "above_hz": recording.rate / 4.0},
            f"efforts ripple above {recording.rate / 4.0:.3g} Hz, the more the faster the joints "
            f"move: about {100 * share:.2g} % of the torque below {settings.ripple_band:g} Hz may "
            "be ripple in disguise; command positions in finer steps, or record at 1 kHz",
        )
    ]


def effort_ripple(recording: Recording) -> float | None:
    """Return the part of the torque that ripple puts into what is fitted, or ``None``.

    It is what efforts have above a quarter of the sampling rate and what grows with the joint's
    speed, as steps of commanded positions do and noise does not: the slope of its square against
    squared velocity. Spread evenly over the frequencies, the band that is fitted has its part of
    it. The median over the joints is returned.
    """
    rate, effort, settings = recording.rate, recording.effort, SignalSettings()
    band, slowest = settings.ripple_band, settings.slowest
    if rate is None or effort is None or rate / 4.0 < band:
        return None
    fresh = max(split_at_gaps(recording.rows(~stale(recording))), key=len)
    if len(fresh) < 200 or fresh.effort is None:
        return None
    inner = slice(20, -20)
    fast = (fresh.effort - LowPass(rate / 4.0, rate)(fresh.effort))[inner] ** 2
    squared_speed = speed(fresh)[inner] ** 2
    torque = np.mean(fresh.effort**2, axis=0)
    shares = []
    for power, squared, whole in zip(fast.T, squared_speed.T, torque, strict=True):
        if np.ptp(squared) > slowest**2 and whole > 0.0:
            relative = squared / squared.max()
            columns = np.column_stack([np.ones_like(relative), relative])
            grows = float(np.linalg.lstsq(columns, power, rcond=None)[0][1] * relative.mean())
            shares.append(np.sqrt(max(grows, 0.0) * band / (rate / 4.0) / whole))
    return float(np.median(shares)) if shares else None


def saturation(recording: Recording, limits: Mapping[str, float]) -> list[DataWarning]:
    """Return findings about efforts that stay at a limit (N·m by joint) or at an extreme."""
    if recording.effort is None:
        return []
    timed, settings = recording.time is not None, SignalSettings()
    fresh, velocity = np.ones(len(recording), dtype=bool), None
    if timed and len(recording) >= 100:
        fresh = ~stale(recording)
        velocity = np.abs(speed(recording))
    findings = []
    for column, joint in enumerate(recording.joints):
        effort = recording.effort[fresh, column]
        if joint in limits:
            pinned = np.abs(effort) >= 0.999 * limits[joint]
            reached, enough = limits[joint], bool(pinned.any())
        else:
            reached = float(effort[np.argmax(np.abs(effort))])
            pinned = effort == reached
            if velocity is None:
                enough = not timed and np.ptp(effort) > 0.0
                least = max(settings.pinned_run, settings.pinned_share * len(effort))
                enough = enough and pinned.sum() > least
            else:
                moving = velocity[fresh, column]
                pinned &= moving > 0.1 * np.sqrt(np.mean(moving**2))
                enough = _longest_run(pinned) >= settings.pinned_run
        if enough:
            findings.append(
                DataWarning(
                    "effort_saturation",
                    joint,
                    {"effort_nm": abs(reached), "samples": int(pinned.sum())},
                    f"effort stays at {reached:.4g} {_effort_unit(recording, joint)} in "
                    f"{pinned.sum()} samples",
                )
            )
    return findings


def quantisation(recording: Recording) -> list[DataWarning]:
    """Return findings about signals whose steps are coarse for the motion."""
    findings, settings = [], SignalSettings()
    rate = recording.rate
    rough = speed(recording) if rate is not None and len(recording) >= 100 else None
    for column, joint in enumerate(recording.joints):
        measured_in = position_unit(recording, joint)
        if rough is not None and rate is not None:
            typical = float(np.sqrt(np.mean(rough[:, column] ** 2)))
            step = quantum(recording.position[:, column])
            if _coarse(step, rate, typical):
                findings.append(
                    DataWarning(
                        "position_quantisation",
                        joint,
                        {
                            f"step_{measured_in}": step,
                            "velocity_step": step * rate,
                            "velocity_rms": typical,
                        },
                        f"position has steps of {step:.3g} {measured_in}: one a sample is "
                        f"{step * rate:.2g} {measured_in}/s, the joint moves at {typical:.2g}",
                    )
                )
        signals: tuple[tuple[Kind, Array | None, str], ...] = (
            ("velocity_quantisation", recording.velocity, f"{measured_in}/s"),
            ("effort_quantisation", recording.effort, _effort_unit(recording, joint)),
        )
        for kind, values, unit in signals:
            if values is None:
                continue
            step, spread = quantum(values[:, column]), float(np.std(values[:, column]))
            if spread > 0.0 and step > settings.coarse * spread:
                findings.append(
                    DataWarning(
                        kind,
                        joint,
                        {"step": step, "spread": spread},
                        f"{kind.split('_')[0]} has steps of {step:.2g} {unit}, its standard "
                        f"deviation is {spread:.2g}",
                    )
                )
    return findings


def _coarse(step: float, rate: float, typical: float) -> bool:
    """Tell whether encoder steps are coarse for a joint of some RMS velocity."""
    settings = SignalSettings()
    if typical <= 0.0 or step * rate <= settings.coarse_position * typical:
        return False
    band = min(settings.step_band, rate / 5.0)
    error = velocity_error(step, band, min(rate, typical / step))
    return error > settings.coarse_velocity * typical


def position_unit(recording: Recording, joint: str) -> str:
    """Return the unit of a joint's position; where the arm is not known, it is taken to turn."""
    arm = recording.arm
    return "rad" if arm is None else arm.units[arm.joint_names.index(joint)]


def _effort_unit(recording: Recording, joint: str) -> str:
    """Return the unit of a joint's effort; where the arm is not known, it is taken to turn."""
    arm = recording.arm
    return "N·m" if arm is None else arm.effort_units[arm.joint_names.index(joint)]
