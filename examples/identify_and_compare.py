# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From a recording to a model, and which model is better
#
# A recording holds time, position, velocity and effort of each joint. Here a simulated master arm
# makes it; with your own, `calibration = Recording.load("my_bag", arm="mtmr")`.

# %%
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from simulated_lab import ARM, record

from dvrk_gravity import evaluate, identify

calibration, unseen = record(seed=1), record(seed=2)
calibration

# %%
frame = calibration.to_dataframe().set_index("time")
frame.filter(like="effort").describe().loc[["mean", "std", "min", "max"]]

# %% [markdown]
# ## Identify
#
# Rigid bodies alone, and with all effects that the package knows: it keeps those that lower the
# error on blocks of the recording which the fit has not seen.

# %%
rigid = identify(calibration, ARM, effects=[])
full = identify(calibration, ARM)
full

# %%
[choice.term for choice in full.choices if choice.added]

# %% [markdown]
# ## Compare, on a motion that neither has seen

# %%
evaluations = {
    name: evaluate(fit.model, unseen) for name, fit in {"rigid": rigid, "full": full}.items()
}
errors = pd.concat(
    {name: each.to_dataframe().set_index("joint")["nrmse"] for name, each in evaluations.items()},
    axis=1,
)
errors

# %%
ax = errors.plot.bar(ylabel="error / torque", rot=30, figsize=(9, 3))

# %% [markdown]
# ## Residuals
#
# What a model leaves, over position and over velocity. Structure is something that it lacks;
# `diagnose` names it (the other notebook).

# %%
joint = "elbow_pitch"
figure, axes = plt.subplots(1, 2, figsize=(9, 3), sharey=True, layout="constrained")
for name, evaluation in evaluations.items():
    (trace,) = evaluation.traces
    k = trace.joints.index(joint)
    residual = 1e3 * (trace.measured - trace.predicted)[:, k]
    axes[0].plot(np.degrees(trace.position[:, k]), residual, ".", markersize=2, label=name)
    axes[1].plot(np.degrees(trace.velocity[:, k]), residual, ".", markersize=2)
axes[0].set(xlabel=f"{joint} [deg]", ylabel="residual [mN·m]")
axes[1].set(xlabel="velocity [deg/s]")
legend = axes[0].legend()
