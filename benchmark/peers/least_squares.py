"""Least squares with Pinocchio's regressor: what a user writes who has no package for it.

Positions are low-passed at 8 Hz without a shift and differentiated; efforts are low-passed alike;
one sample in four of 200 Hz is kept. Beside the links: viscous and Coulomb friction, rotor inertia
and an offset at every joint. Base parameters by a QR with pivoting (Gautier 1991), joints weighted
by their residual, intervals by the residual with samples taken as independent at the cut-off.
"""

from __future__ import annotations

# fmt: off
# --- the user's lines begin ---
import numpy as np
import pinocchio as pin
from exchange import INERTIAL, Case, Fitted, Parameter, read, run
from scipy.linalg import qr, solve_triangular
from scipy.signal import butter, sosfiltfilt

CUTOFF, KEPT = 8.0, 50.0  # Hz
SMOOTH = 0.02  # rad/s or m/s, within which friction turns round


def smoothed(t, q, effort, rate):
    """Return low-passed positions, their derivatives and efforts."""
    sos = butter(2, CUTOFF, fs=rate, output="sos")
    q, effort = sosfiltfilt(sos, q, axis=0), sosfiltfilt(sos, effort, axis=0)
    qd = np.gradient(q, 1.0 / rate, axis=0)
    return q, qd, np.gradient(qd, 1.0 / rate, axis=0), effort


def regressor(model, q, qd, qdd):
    """Return (N, n, 14 n): links, then viscous and Coulomb friction, rotors, offsets."""
    data, n = model.createData(), model.nv
    rows = [pin.computeJointTorqueRegressor(model, data, *s).copy()
            for s in zip(q, qd, qdd, strict=True)]
    own = np.zeros((len(q), n, 4 * n))
    for j in range(n):
        for k, column in enumerate((qd[:, j], np.tanh(qd[:, j] / SMOOTH), qdd[:, j], 1.0)):
            own[:, j, k * n + j] = column
    return np.concatenate([np.array(rows), own], axis=2)


def base(model):
    """Return independent columns and what the others add to them: theta_base = M theta."""
    random = np.random.default_rng(0)
    q, qd, qdd = random.uniform(-1.5, 1.5, (3, 200, model.nv))
    y = regressor(model, q, qd, qdd).reshape(200 * model.nv, -1)
    norm = np.linalg.norm(y, axis=0)
    norm[norm < 1e-9] = np.inf
    r, order = qr(y / norm, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(r)) > 1e-8 * abs(r[0, 0])))
    more = solve_triangular(r[:rank, :rank], r[:rank, rank:])
    m = np.zeros((rank, y.shape[1]))
    m[np.arange(rank), order[:rank]] = 1.0
    m[:, order[rank:]] = more / norm[order[:rank], None] * np.where(
        np.isinf(norm[order[rank:]]), 0.0, norm[order[rank:]])
    return order[:rank], m


def fit(case: Case, recording: str) -> Fitted:
    """Fit by weighted least squares."""
    model = pin.buildModelFromUrdf(case.urdf)
    time, position, measured = read(case, recording)
    q, qd, qdd, effort = smoothed(time, position, measured, case.rate)
    edge, step = int(0.5 * case.rate), max(round(case.rate / KEPT), 1)
    rows = slice(edge, -edge, step)
    columns, m = base(model)
    x = regressor(model, q[rows], qd[rows], qdd[rows])[:, :, columns]
    y, weight = effort[rows], np.ones(model.nv)
    for _ in range(2):
        a = (x * weight[:, None]).reshape(-1, len(columns))
        theta = np.linalg.lstsq(a, (y * weight).ravel(), rcond=None)[0]
        weight = 1.0 / np.std(y - x @ theta, axis=0)
    a = (x * weight[:, None]).reshape(-1, len(columns))
    correlated = KEPT / (2.0 * CUTOFF)  # samples that share their noise
    half = 1.96 * np.sqrt(correlated * np.diag(np.linalg.pinv(a.T @ a)))
    names = [f"{k}_{j}" for j in case.joints for k in INERTIAL]
    names += [f"{k}_{j}" for k in ("fv", "fs", "Ia", "off") for j in case.joints]
    full = np.zeros(len(names))
    full[columns] = theta

    def predict(q, qd, qdd):
        return regressor(model, q, qd, qdd) @ full

    # --- the user's lines end ---
    # fmt: on
    parameters = [
        Parameter(names[c], theta[i], half[i], {names[k]: m[i, k] for k in np.flatnonzero(m[i])})
        for i, c in enumerate(columns)
    ]
    # Any links with these base parameters move alike: those next to the URDF's are the fairest.
    stated = np.concatenate([model.inertias[i + 1].toDynamicParameters() for i in range(model.nv)])
    stated = np.concatenate([stated, np.zeros(4 * model.nv)])
    near = stated + np.linalg.pinv(m) @ (theta - m @ stated)
    bodies = {j: near[10 * i : 10 * i + 10] for i, j in enumerate(case.joints)}
    return Fitted(predict, parameters, bodies)


if __name__ == "__main__":
    run(fit)
