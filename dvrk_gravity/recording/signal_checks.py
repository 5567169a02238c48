"""Checks of the signals: stale and jittering samples, steps, efforts of the wrong sign."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.limits import effort_unit, position_unit
from dvrk_gravity.recording.notes import Kind, Note
from dvrk_gravity.recording.quantization import quantum, velocity_error
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.renewal import LEAST_RATE, OWN, common, holds, in_words
from dvrk_gravity.recording.timing import retimed, speed, split_at_gaps, stale
from dvrk_gravity.units import percent

# When signals are worse than they seem.
_STALE = 0.01  # part of the samples that repeat the one before while the arm moves. Chosen
_READ_JITTER = 0.2  # RMS of samples off their stamps, in sampling intervals. Chosen
_COARSE_POSITION = 0.1  # one encoder step a sample, as a part of the joint's RMS velocity. Chosen
# Error of the derived velocity below _STEP_BAND, likewise: at 200 Hz that of _COARSE_POSITION. In
# faster samples a step is a larger velocity, and the error in the band is not.
_COARSE_VELOCITY = 0.0047
_STEP_BAND = 20.0  # Hz; motion is used below it (`diagnosis.load`)
_COARSE = 0.05  # one step, as a part of the signal's standard deviation. Chosen
_PINNED_RUN = 5  # equal extreme readings in a row, while the joint moves. Chosen
_PINNED_SHARE = 0.02  # part of static poses with the same extreme effort. Chosen
# Part of the torque that ripple puts into the fitted band. Real recordings (MTM, PSM, UR10e) have
# 0.000 to 0.005, simulated ones without steps 0.000 to 0.004 (`Multisine.draw`, seeds 0 to 7, at
# 100, 200, 1000 Hz); a stiff servo that follows steps at 50 to 500 Hz leaves 0.03 to 0.15 at
# 200 Hz, 0.01 to 0.04 at 1 kHz (seeds 1 to 4 of `stepped` in test/trials/test_set_points.py).
_RIPPLE = 0.01
_RIPPLE_BAND = 5.65  # Hz, that is fitted: `DEFAULT_CUTOFF`
_SLOWEST = 1e-6  # rad/s; a slower joint shows no jitter. Chosen: rounding
# Part of the work there and back that friction has given to the motor, where none can be, beside
# what springs and weight may still give back: once over the range. Real arms have 0.2 to 1.0 of it
# the other way round (the recordings of docs/psm.md, docs/own_arm.md and docs/identification.md).
# Chosen; among neighbours' weights and springs the sum of one joint need not be its friction's.
_DRIVEN = 0.2


def _longest_run(mask: Mask) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def sampling(recording: Recording) -> list[Note]:
    """Return findings about stale samples and samples taken off their stamps."""
    findings = []
    old = stale(recording)
    if np.mean(old) > _STALE:
        longest = _longest_run(old)
        numbers = {"samples": int(old.sum()), "share": float(np.mean(old)), "longest": longest}
        text = (
            f"{old.sum()} of {len(recording)} samples repeat the previous one while the "
            f"arm moves, up to {longest} in a row"
        )
        findings.append(Note("stale_samples", None, numbers, text))
    # Over a gap nothing is smooth.
    part = max(split_at_gaps(recording), key=len)
    jitter = read_jitter(part)
    rate = recording.rate
    fresh = part.rows(~stale(part))  # as they are prepared: interpolated over, no gap
    corrected = rate is not None and retimed(fresh) is not fresh
    if jitter is None or rate is None:
        return findings
    if corrected or jitter * rate > _READ_JITTER:
        numbers = {"jitter_s": jitter, "interval_s": 1.0 / rate, "corrected": float(corrected)}
        text = (
            f"samples and their stamps differ by about {1e3 * jitter:.2g} ms, stale samples "
            f"included (interval {1e3 / rate:.3g} ms)"
            + ("; corrected by matching positions and velocities" if corrected else "")
        )
        findings.append(Note("read_jitter", None, numbers, text))
    return findings


def held(recording: Recording) -> list[Note]:
    """Return findings about positions and efforts that are renewed more slowly than recorded.

    Below ``LEAST_RATE`` they cannot be used.
    """
    rate, findings = recording.rate or 0.0, []
    for quantity, hold in holds(recording).items():
        if hold is None:
            continue
        renewals = rate / hold.samples
        unusable = renewals < LEAST_RATE
        if not unusable and hold.samples < OWN * common(recording):
            continue  # stale samples
        text = f"{in_words(recording, quantity, hold)}, and late by half of that"
        if unusable:
            text += f"; expected {LEAST_RATE:g} Hz or more: record what the driver renews faster"
        numbers = {"renewals_hz": renewals, "hold_s": hold.samples / rate}
        findings.append(Note("held_readings", None, numbers, text, unusable))
    return findings


def read_jitter(recording: Recording) -> float | None:
    """Return how far samples lie off their stamps, RMS in s; ``None`` if it cannot be estimated.

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
    slopes = []
    for error, squared in zip((rough[inner] ** 2).T, squared_speed.T, strict=True):
        if np.ptp(squared) > _SLOWEST**2:
            columns = np.column_stack([np.ones_like(squared), squared / squared.max()])
            slopes.append(np.linalg.lstsq(columns, error, rcond=None)[0][1] / squared.max())
    return float(np.sqrt(max(np.median(slopes), 0.0))) if slopes else None


def ripple(recording: Recording) -> list[Note]:
    """Return a finding if efforts ripple with the motion faster than the recording can follow.

    A position servo answers every step of its commands with a pulse of torque. Pulses faster than
    half the sampling rate alias to any frequency below it: as much into the fitted band as into an
    equally wide one above. Commands in exact step with the samples would show no ripple and do the
    same harm; clocks of two programs are never so exact.
    """
    share = effort_ripple(recording)
    if share is None or share <= _RIPPLE or recording.rate is None:
        return []
    text = (
        f"efforts ripple above {recording.rate / 4.0:.3g} Hz, more at higher joint speed: "
        f"about {percent(share)} of the torque below {_RIPPLE_BAND:g} Hz may "
        "be aliased ripple; command positions in finer steps, or record at 1 kHz"
    )
    numbers = {"share": share, "above_hz": recording.rate / 4.0}
    return [Note("effort_ripple", None, numbers, text)]


def effort_ripple(recording: Recording) -> float | None:
    """Return the part of the torque that ripple puts into the fitted band, or ``None``.

    Ripple is the part of efforts above a quarter of the sampling rate that grows with the joint's
    speed, as steps of commanded positions do and noise does not: the slope of its square against
    squared velocity. It is taken as spread evenly over the frequencies; the median over the joints
    is returned.
    """
    rate, effort, band = recording.rate, recording.effort, _RIPPLE_BAND
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
        if np.ptp(squared) > _SLOWEST**2 and whole > 0.0:
            relative = squared / squared.max()
            columns = np.column_stack([np.ones_like(relative), relative])
            grows = float(np.linalg.lstsq(columns, power, rcond=None)[0][1] * relative.mean())
            shares.append(np.sqrt(max(grows, 0.0) * band / (rate / 4.0) / whole))
    return float(np.median(shares)) if shares else None


def saturation(recording: Recording) -> list[Note]:
    """Return findings about efforts that stay at an extreme."""
    if recording.effort is None:
        return []
    timed = recording.time is not None
    fresh, velocity = np.ones(len(recording), dtype=bool), None
    if timed and len(recording) >= 100:
        fresh = ~stale(recording)
        velocity = np.abs(speed(recording))
    findings = []
    for column, joint in enumerate(recording.joints):
        effort = recording.effort[fresh, column]
        reached = float(effort[np.argmax(np.abs(effort))])
        pinned = effort == reached
        if velocity is None:
            enough = not timed and np.ptp(effort) > 0.0
            least = max(_PINNED_RUN, _PINNED_SHARE * len(effort))
            enough = enough and pinned.sum() > least
        else:
            moving = velocity[fresh, column]
            moves = moving > 0.1 * np.sqrt(np.mean(moving**2))
            pinned &= moves
            # Coarse steps repeat at any effort, and not for less long than at the extremes.
            inside = (effort > effort.min()) & (effort < effort.max())
            again = (moves & inside)[1:] & (np.diff(effort) == 0.0)
            enough = _longest_run(pinned) >= max(_PINNED_RUN, 2 * (1 + _longest_run(again)))
        if enough:
            count, unit = int(pinned.sum()), effort_unit(recording, joint)
            numbers = {"effort_nm": abs(reached), "samples": count}
            text = f"effort stays at {reached:.4g} {unit} in {count} samples"
            findings.append(Note("effort_saturation", joint, numbers, text))
    return findings


def quantisation(recording: Recording) -> list[Note]:
    """Return findings about signals whose steps are coarse for the motion."""
    findings = []
    rate = recording.rate
    rough = speed(recording) if rate is not None and len(recording) >= 100 else None
    for column, joint in enumerate(recording.joints):
        measured_in = position_unit(recording, joint)
        if rough is not None and rate is not None:
            typical = float(np.sqrt(np.mean(rough[:, column] ** 2)))
            step = quantum(recording.position[:, column])
            if _coarse(step, rate, typical):
                numbers = {
                    f"step_{measured_in}": step,
                    "velocity_step": step * rate,
                    "velocity_rms": typical,
                }
                text = (
                    f"encoder resolution is coarse ({step:.3g} {measured_in}): differentiated "
                    f"velocity has steps of {step * rate:.2g} {measured_in}/s at a joint speed of "
                    f"{typical:.2g}"
                )
                findings.append(Note("position_quantisation", joint, numbers, text))
        signals: tuple[tuple[Kind, Array | None, str], ...] = (
            ("velocity_quantisation", recording.velocity, f"{measured_in}/s"),
            ("effort_quantisation", recording.effort, effort_unit(recording, joint)),
        )
        for kind, values, unit in signals:
            if values is None:
                continue
            step, spread = quantum(values[:, column]), float(np.std(values[:, column]))
            if spread > 0.0 and step > _COARSE * spread:
                text = (
                    f"{kind.split('_')[0]} has steps of {step:.2g} {unit}, its standard "
                    f"deviation is {spread:.2g}"
                )
                numbers = {"step": step, "spread": spread}
                findings.append(Note(kind, joint, numbers, text))
    return findings


def _coarse(step: float, rate: float, typical: float) -> bool:
    """Return whether encoder steps are coarse for a joint of some RMS velocity."""
    if typical <= 0.0 or step * rate <= _COARSE_POSITION * typical:
        return False
    band = min(_STEP_BAND, rate / 5.0)
    error = velocity_error(step, band, min(rate, typical / step))
    return error > _COARSE_VELOCITY * typical


def driven_motors(recording: Recording) -> list[Note]:
    """Return findings about motors that friction would drive: their efforts have the wrong sign."""
    if recording.effort is None:
        return []
    way = np.diff(recording.position, axis=0)
    work = 0.5 * (recording.effort[1:] + recording.effort[:-1]) * way
    there_and_back = np.abs(work).sum(axis=0)
    length = np.maximum(np.abs(way).sum(axis=0), 1e-300)
    last = np.ptp(recording.position, axis=0) / length  # part of the way without a return
    findings = []
    for joint in np.flatnonzero(there_and_back > 0.0).tolist():
        part = float(work[:, joint].sum() / there_and_back[joint])
        if part < -_DRIVEN - last[joint]:
            text = (
                f"its motor takes {-100 * part:.0f} % of the work there and back out of the "
                "arm, as if friction drove it: an effort of the wrong sign, or of another "
                "joint, a hand that moves the arm, or work transferred from other joints"
            )
            findings.append(Note("effort_sign", recording.joints[joint], {"work": part}, text))
    return findings
