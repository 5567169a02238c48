"""How large and heavy a master arm's links are, about."""

SIZES = {  # mass kg, extent m
    "link1": [1.0, 0.15],
    "link2": [0.8, 0.3],
    "crank": [0.2, 0.1],
    "link3": [0.4, 0.35],
    "bar": [0.3, 0.3],
    "link4": [0.4, 0.2],
    "link5": [0.15, 0.12],
    "link6": [0.1, 0.08],
    "link7": [0.05, 0.04],
}
