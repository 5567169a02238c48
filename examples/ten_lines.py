"""A model of an arm from one recording, its error on another, and what changed since."""

from simulated_lab import record  # yours: Recording.load("my_bag", arm="mtmr")

from dvrk_gravity import diagnose, evaluate, identify

fit = identify(record(seed=1), "mtmr")
fit.model.save("model.yaml")  # the compensator's parameter file
print(fit, evaluate(fit.model, record(seed=2)), sep="\n")

worn = record(seed=3, viscous_friction__joint=[0.02, 0.02, 0.1, 0.003, 0.0005, 0.0005, 0.0001])
print(diagnose(worn, fit.model).sentence)
