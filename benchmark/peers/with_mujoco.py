"""mujoco.sysid, as its README uses it: parameters, sequences, a residual, ``optimize``.

Options: every link by ``InertiaType.Pseudo`` (ten parameters, physically consistent) within its
default bounds; damping, frictionloss and armature of every joint; a bias of every torque sensor
(``SignalTransform.bias`` of what is predicted: its default adds it to both sides, where it
cancels). Efforts are compared by inverse dynamics in ``custom_rollout``, one of its tiers of
customization: a rollout under recorded efforts leaves the recorded motion within seconds. Motions
as in least_squares.py, but 25 samples a second of what is below 8 Hz, since every iteration
simulates every sample once a parameter. Its own Gauss-Newton stops after 25 iterations: its default
of 200 takes minutes. ``InertiaType.Pseudo`` leaves ``iquat`` NaN, which the compiler refuses here:
the modifier sets it.
Intervals: ``calculate_intervals``.
"""

from __future__ import annotations

# fmt: off
# --- the user's lines begin ---
import mujoco
import numpy as np
from exchange import Case, Fitted, Parameter, read, run
from least_squares import smoothed
from mujoco import sysid

KEPT, ITERATIONS = 25.0, 25  # Hz


def inverse(model, q, qd, qdd):
    """Return (N, n) efforts by inverse dynamics."""
    data = mujoco.MjData(model)
    effort = np.empty(q.shape)
    for row, (data.qpos, data.qvel, data.qacc) in enumerate(zip(q, qd, qdd, strict=True)):
        mujoco.mj_inverse(model, data)
        effort[row] = data.qfrc_inverse
    return effort


def body_modifier(body):
    """Return what applies a pseudo-inertia, with a quaternion that the compiler accepts."""

    def apply(spec, parameter):
        sysid.apply_body_inertia(spec, body, parameter)
        spec.body(body).iquat = [1.0, 0.0, 0.0, 0.0]

    return apply


def joint_modifier(joint, name):
    """Return what sets a joint's damping, frictionloss or armature."""

    def apply(spec, parameter):
        value = parameter.value[0]
        setattr(spec.joint(joint), name, [value, 0, 0] if name == "damping" else value)

    return apply


def described(case: Case):
    """Return the arm with a torque sensor at every joint, and its parameters."""
    spec = mujoco.MjSpec.from_file(case.urdf)
    spec.option.timestep = 1.0 / KEPT
    model = spec.compile()
    parameters, transform = sysid.ParameterDict(), sysid.SignalTransform()
    for joint, limit in zip(case.joints, case.effort_limit, strict=True):
        spec.joint(joint).limited = 0
        spec.add_actuator(name=f"{joint}_motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        spec.add_sensor(name=f"{joint}_torque", type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                        objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
        body = model.body(model.jnt_bodyid[model.joint(joint).id]).name
        parameters.add(sysid.body_inertia_param(
            spec, model, body, sysid.InertiaType.Pseudo, modifier=body_modifier(body)))
        for name, start, most in (("damping", 0.01, 0.5), ("frictionloss", 0.01, 0.3),
                                  ("armature", 0.002, 0.1)):
            parameters.add(sysid.Parameter(f"{name}_{joint}", start * limit, 0.0, most * limit,
                                           modifier=joint_modifier(joint, name)))
        parameters.add(sysid.Parameter(f"bias_{joint}", 0.0, -0.3 * limit, 0.3 * limit))
        transform.bias(f"{joint}_torque", parameters[f"bias_{joint}"], target="predicted")
    return spec, parameters, transform


def optimized(case: Case, recording: str):
    """Return the arm's parameters and their intervals."""
    q, qd, qdd, effort = smoothed(*read(case, recording), case.rate)
    edge, step = int(0.5 * case.rate), max(round(case.rate / KEPT), 1)
    rows = slice(edge, -edge, step)
    q, qd, qdd, effort = q[rows], qd[rows], qdd[rows], effort[rows]
    time = np.arange(len(q)) * step / case.rate
    spec, parameters, transform = described(case)
    model = spec.compile()

    def rollout(models, control_signal, initial_states, rollout_signal_mapping,
                rollout_state_mapping, **_):
        state = sysid.TimeSeries(time, np.hstack([time[:, None], q, qd]), rollout_state_mapping)
        return [
            sysid.SystemTrajectory(candidate, control, sysid.TimeSeries(
                time, inverse(candidate, q, qd, qdd), rollout_signal_mapping), start, state)
            for candidate, control, start in zip(
                models, control_signal, initial_states, strict=True)]

    start = sysid.create_initial_state(model, q[0], qd[0])
    sequence = sysid.ModelSequences(
        "arm", spec, "recording", start,
        sysid.TimeSeries.from_control_names(time, effort, model),
        sysid.TimeSeries.from_names(time, effort, model))
    residual = sysid.build_residual_fn(models_sequences=[sequence], custom_rollout=rollout,
                                       modify_residual=transform.apply, n_threads=1)
    found, result = sysid.optimize(parameters, residual, verbose=False, max_iters=ITERATIONS)
    left = residual(found.as_vector(), found)[0]
    _, intervals = sysid.calculate_intervals(left, result.jac)
    return spec, found, intervals


def predict(case: Case, spec, found, q, qd, qdd):
    """Return efforts (N, n)."""
    bias = [found[f"bias_{joint}"].value[0] for joint in case.joints]
    return inverse(sysid.apply_param_modifiers(found, spec), q, qd, qdd) + np.array(bias)


# --- the user's lines end ---
# fmt: on
_OWN = {"damping": "fv", "frictionloss": "fs", "armature": "Ia", "bias": "off"}


def fit(case: Case, recording: str) -> Fitted:
    """Fit, and hand over what the tables need."""
    spec, found, intervals = optimized(case, recording)
    model = sysid.apply_param_modifiers(found, spec)
    parameters, bodies, at = [], {}, 0
    of_body = {model.body(model.jnt_bodyid[model.joint(j).id]).name: j for j in case.joints}
    for name, parameter in found.items():
        half = intervals[at : at + parameter.size]
        at += parameter.size
        if parameter.size == 1:
            kind, _, joint = name.partition("_")
            own = f"{_OWN[kind]}_{joint}"
            parameters.append(Parameter(own, parameter.value[0], half[0], {own: 1.0}))
            continue
        joint = of_body[name.removesuffix("_inertia")]
        theta = parameter.value
        pi = sysid.model_modifier.pi_from_theta(theta)
        full = pi[4:].reshape(3, 3)
        bodies[joint] = [
            *pi[:4],
            full[0, 0],
            full[0, 1],
            full[1, 1],
            full[0, 2],
            full[1, 2],
            full[2, 2],
        ]
        truth = _true_theta(case, joint)
        for k, value in enumerate(theta):
            # The first scales mass and all else; the last three are the centre of mass.
            kind = "m" if k == 0 else ("mx", "my", "mz")[k - 7] if k > 6 else f"I{k}"
            parameters.append(Parameter(f"{kind}_{joint}", value, half[k], {}, truth[k]))
    return Fitted(lambda *motion: predict(case, spec, found, *motion), parameters, bodies)


def _true_theta(case: Case, joint: str) -> list[float | None]:
    if f"m_{joint}" not in case.truth:
        return [None] * 10
    m, cx, cy, cz, xx, xy, yy, xz, yz, zz = (
        case.truth[f"{kind}_{joint}"]
        for kind in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    )
    pi = np.array([m, cx, cy, cz, xx, xy, xz, xy, yy, yz, xz, yz, zz])
    pseudo = sysid.model_modifier.pseudoinertia_from_pi(pi)
    return list(sysid.model_modifier.theta_from_pseudoinertia(pseudo))


if __name__ == "__main__":
    run(fit)
