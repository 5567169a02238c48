"""A model that does not know its error on a recording says which difference is the reason."""

from __future__ import annotations

from types import SimpleNamespace

from dvrk_gravity.report import fit_in_terminal

NAN = float("nan")


REASONS = (  # band, Hz, cutoff, Hz, coordinates, and what is said of them
    (8.0, 5.65, "joint", ("8 Hz", "5.65 Hz", "identify")),
    (NAN, 5.65, "joint", ("poses", "trajectories")),
    (5.65, None, "joint", ("trajectories", "poses")),
    (5.65, 5.65, "actuator", ("joint coordinates", "motors")),
    (NAN, None, "joint", ("held-out", "longer recording")),
)


def test_an_unknown_error_has_one_reason():
    for band, cutoff, coordinates, tokens in REASONS:
        result = SimpleNamespace(expected={}, cutoff=cutoff, coordinates=coordinates)
        model = SimpleNamespace(
            of_file=False,
            why_no_uncertainty="",
            uncertainty=SimpleNamespace(band=band),
            arm=SimpleNamespace(direct_drive=False),
        )

        said = fit_in_terminal.expectation(result, model)

        where = [said.index(token) for token in tokens]
        assert where == sorted(where), said
        assert "\n" not in said
