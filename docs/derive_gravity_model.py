"""Derive the MTM's symbolic gravity model and set it beside the printed document.

    PYTHONPATH=. python docs/derive_gravity_model.py

prints the tables and figures of ``docs/gravity_model.md``. The derivation starts from the DH
table and the potential energy and shares nothing with ``dvrk_gravity.gravity``: sines and
cosines are the generators of a polynomial ring, every entry is exact, and the torque is the
derivative of the energy. No entry holds two factors of the same joint, so that two entries
are equal exactly when their polynomials are.
"""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import sympy

from dvrk_gravity.gravity import regressor

JOINTS = range(1, 8)
RING, *GENERATORS = sympy.ring(
    [f"{f}{i}" for f in "cs" for i in JOINTS] + ["nx", "ny", "nz"], sympy.QQ
)
C = dict(zip(JOINTS, GENERATORS[:7], strict=True))
S = dict(zip(JOINTS, GENERATORS[7:14], strict=True))
UP = GENERATORS[14:]  # -gravity / 9.81 in the base frame

# The lengths are distinct primes, so that a coefficient names the length that it came from.
LENGTHS = {"l_arm": 2, "l_forearm": 3, "h": 5, "l'_forearm": 7}
# alpha / 90 deg, a, d, offset of theta / 90 deg
DH = (
    (1, None, None, -1),
    (0, "l_arm", None, -1),
    (-1, "l_forearm", None, 1),
    (1, None, "h", 0),
    (-1, None, None, 0),
    (1, None, None, -1),
    (0, None, None, 1),
)
# The moment that stands for each column: (link, axis of its frame).
BASE = (
    ("2", "x"), ("2", "y"), ("3", "x"), ("3", "z"), ("4", "x"), ("5", "y"), ("5", "z"),
    ("5", "x"), ("6", "z"), ("6", "x"), ("7", "x"), ("7", "y"), ("1", "x"), ("1", "z"),
)  # fmt: skip

Y2_PRINTED = (
    "s_{2}",
    "c_{2}",
    "c_{2}c_{3} - s_{2}s_{3}",
    "-c_{2}s_{3} - c_{3}s_{2}",
    "c_{2}c_{3}c_{4} - c_{4}s_{2}s_{3}",
    "s_{2}s_{3}s_{4} - c_{2}c_{3}s_{4}",
    "c_{4}s_{2}s_{3}s_{5} - c_{3}c_{5}s_{2} - c_{2}c_{3}c_{4}s_{5} - c_{2}c_{5}s_{3}",
    "c_{2}c_{3}c_{4}c_{5} - c_{3}s_{2}s_{5} - c_{2}s_{3}s_{5} - c_{4}c_{5}s_{2}s_{3}",
    "c_{2}c_{3}s_{4}s_{6} + c_{2}c_{6}s_{3}s_{5} + c_{3}c_{6}s_{2}s_{5} - s_{2}s_{3}s_{4}s_{6}"
    " + c_{4}c_{5}c_{6}s_{2}s_{3} - c_{2}c_{3}c_{4}c_{5}c_{6}",
    "c_{2}c_{3}c_{6}s_{4} - c_{6}s_{2}s_{3}s_{4} - c_{2}s_{3}s_{5}s_{6} - c_{3}s_{2}s_{5}s_{6}"
    " - c_{4}c_{5}s_{2}s_{3}s_{6} + c_{2}c_{3}c_{4}c_{5}s_{6}",
)
# What the document prints, entry by entry; an entry that is not here is missing there.
PRINTED = {
    1: dict.fromkeys(range(1, 10), "0"),
    2: dict(enumerate(Y2_PRINTED, start=1)),
    3: {
        1: "0",
        3: "c_2c_3 - s_2s_3",
        4: "-c_2s_3-c_3s_2",
        5: "c_2c_3c_4 - c_4s_2s_3",
        6: "s_2s_3s_4 - c_2c_3s_4",
        7: "c_4s_2s_3s_5 - c_3c_5s_2 - c_2c_3c_4s_5 - c_2c_5s_3",
        8: "c_2c_3c_4c_5-c_3s_2s_5-c_2s_3s_5-c_4c_5s_2s_3",
        9: "c_2c_3s_4s_6 + c_2c_6s_3s_5 + c_3c_6s_2s_5 - s_2s_3s_4s_6"
        " + c_4c_5c_6s_2s_3 - c_2c_3c_4c_5c_6",
        10: "c_2c_3c_6s_4 - c_6s_2s_3s_4 - c_2s_3s_5s_6 - c_3s_2s_5s_6"
        " - c_4c_5s_2s_3s_6 + c_2c_3c_4c_5s_6",
    },
    4: {9: "s_2 + q3c_4s_6 + c_5c_6s_4", 10: "s_2 + q3c_4c_6 - c_5s_4s_6"},
    5: {
        7: "-c_2c_3s_5 - s_2s_3s_5 + c_2c_4c_5s_3 + c_3c_4c_5s_2",
        8: "-c_5s_2s_3-c_2c_3c_5+c_2c_4s_3s_5+c_3c_4s_2s_5",
        9: "c_5c_6s_2s_3-c_2c_3c_5c_6+c_2c_4c_6s_3s_5+c_3c_4c_6s_2s_5",
        10: "-c_5s_2s_3s_6-c_2c_3c_5s_6+c_2c_4s_3s_5s_6+c_3c_4s_2s_5s_6",
    },
    6: {
        9: "c_2c_6s_3s_4 + c_3c_6s_2s_4 + c_2c_3s_5s_6 - s_2s_3s_5s_6"
        " + c_2c_4c_5s_3s_6 + c_3c_4c_5s_2s_6",
        10: "c_2c_3c_6s_5 - c_2s_3s_4s_6 - c_3s_2s_4s_6 - c_6s_2s_3s_5"
        " + c_2c_4c_5c_6s_3 + c_3c_4c_5c_6s_2",
    },
    7: dict.fromkeys(range(1, 10), "0"),
}
# The damaged entries with their lost brackets put back.
MENDED = {
    (4, 9): "s_23(c_4s_6 + c_5c_6s_4)",
    (4, 10): "s_23(c_4c_6 - c_5s_4s_6)",
    (5, 7): "-(c_2c_3s_5 - s_2s_3s_5 + c_2c_4c_5s_3 + c_3c_4c_5s_2)",
    (5, 8): "-(c_5s_2s_3-c_2c_3c_5+c_2c_4s_3s_5+c_3c_4s_2s_5)",
    (5, 10): "-(c_5s_2s_3s_6-c_2c_3c_5s_6+c_2c_4s_3s_5s_6+c_3c_4s_2s_5s_6)",
}
# Short forms of the derived entries, columns 1 to 10; the entries of the other rows are zero.
_ROWS_2_3 = (
    "c_23", "-s_23", "c_23c_4", "-c_23s_4", "-c_23c_4s_5 - s_23c_5", "c_23c_4c_5 - s_23s_5",
    "c_23(s_4s_6 - c_4c_5c_6) + s_23s_5c_6", "c_23(s_4c_6 + c_4c_5s_6) - s_23s_5s_6",
)  # fmt: skip
SHORT = {
    1: ("0",) * 10,
    2: ("s_2", "c_2", *_ROWS_2_3),
    3: ("0", "0", *_ROWS_2_3),
    4: ("0",) * 4
    + ("-s_23s_4", "-s_23c_4", "s_23s_4s_5", "-s_23s_4c_5")
    + ("s_23(c_4s_6 + s_4c_5c_6)", "s_23(c_4c_6 - s_4c_5s_6)"),
    5: ("0",) * 6
    + ("-s_23c_4c_5 - c_23s_5", "c_23c_5 - s_23c_4s_5")
    + ("c_6(s_23c_4s_5 - c_23c_5)", "s_6(c_23c_5 - s_23c_4s_5)"),
    6: ("0",) * 8
    + ("s_6(s_23c_4c_5 + c_23s_5) + s_23s_4c_6", "c_6(s_23c_4c_5 + c_23s_5) - s_23s_4s_6"),
    7: ("0",) * 10,
}
PRINTED_BETA = (
    "l_arm m2 + l_arm m3 + l_arm m4 + l_arm m5 + l_arm m6 + cm2x m2 - cm4'x m4'",
    "cm2y m2 - cm4'y m4'",
    "cm3x m3 - cm5'y m5' + l_forearm m3 + l_forearm m4 + l_forearm m5 + l_forearm m6"
    " + l'_forearm m4' + l'_forearm m5'",
    "cm3z m3 + cm4y m4 + cm5'x m5' + h m4 + h m5 + h m6",
    "cm4x m4",
    "cm5y m5 - cm4z m4",
    "cm5z m5 + cm6y m6",
    "cm5x m5",
    "cm6z m6",
    "cm6z m6",
)


def parse(text: str) -> Any:
    """Return the polynomial of an entry as printed; s_23 is sin(q2 + q3).

    Raises:
        ValueError: the text holds anything but sines, cosines, signs and brackets.
    """
    text = re.sub(r"[_{}\s]", "", text)
    tokens = re.findall(r"[cs]\d+|[-+()0]", text)
    if "".join(tokens) != text:
        raise ValueError(text)
    names = {str(g): g for g in GENERATORS}
    names["s23"] = S[2] * C[3] + C[2] * S[3]
    names["c23"] = C[2] * C[3] - S[2] * S[3]
    product = re.sub(r"(?<=[\d)])(?=[cs(])", "*", "".join(tokens))
    return RING.ground_new(0) + eval(product, {"__builtins__": {}}, names)


def _turn(cosine: Any, sine: Any) -> np.ndarray:
    """Return the rotation about z as an object array of ring elements or integers."""
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], dtype=object)


def frames() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (rotation, origin) of the DH frames 0 to 7 in the base, exact."""
    placed = [(np.eye(3, dtype=int).astype(object), np.zeros(3, dtype=int).astype(object))]
    quarter = {0: (1, 0), 1: (0, 1), -1: (0, -1)}
    for i, (alpha, a, d, offset) in enumerate(DH, start=1):
        rotation, origin = placed[-1]
        turned = rotation @ _turn(C[i], S[i]) @ _turn(*quarter[offset])
        origin = origin + turned @ [LENGTHS.get(a, 0), 0, LENGTHS.get(d, 0)]
        cosine, sine = quarter[alpha]
        twist = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]], dtype=object)
        placed.append((turned @ twist, origin))
    return placed


def torque_of_height(point: np.ndarray) -> tuple:
    """Return the seven derivatives of n . point, the torque of a unit weight there."""
    height = RING.ground_new(0) + np.dot(UP, point)
    return tuple(C[j] * height.diff(S[j]) - S[j] * height.diff(C[j]) for j in JOINTS)


def link_frames() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return (rotation, origin) of the document's frames: links 1 to 7, 4' and 5'."""
    placed = frames()
    links = {str(i): placed[i] for i in JOINTS}
    (arm, _), (forearm, _) = placed[2], placed[3]
    tip = placed[1][1] + LENGTHS["l'_forearm"] * forearm[:, 0]
    links["4'"] = (np.column_stack([-arm[:, 0], -arm[:, 1], arm[:, 2]]), tip)
    links["5'"] = (np.column_stack([forearm[:, 2], -forearm[:, 0], -forearm[:, 1]]), tip)
    return links


def columns() -> list[tuple]:
    """Return the fourteen columns, each of seven polynomials, for any direction of gravity."""
    links = link_frames()
    return [torque_of_height(links[link][0][:, "xyz".index(axis)]) for link, axis in BASE]


def vertical(column: tuple) -> tuple:
    """Return a column for gravity along -z of the base."""
    return tuple(entry.subs([(UP[0], 0), (UP[1], 0), (UP[2], 1)]) for entry in column)


def coordinates(column: tuple, basis: list[tuple]) -> list[int]:
    """Return the integers that combine the basis columns into the given column.

    Raises:
        ValueError: no integers do.
    """
    found = sorted({(j, m) for c in [column, *basis] for j in range(7) for m in c[j].monoms()})
    flat = np.array([[float(c[j].get(m, 0)) for j, m in found] for c in [column, *basis]])
    solution = np.rint(np.linalg.lstsq(flat[1:].T, flat[0], rcond=None)[0]).astype(int)
    if (solution @ flat[1:] != flat[0]).any():
        raise ValueError("not a combination of the base columns")
    return solution.tolist()


def derived_beta() -> list[dict[str, int]]:
    """Return, for every base parameter, its terms: 'l_arm m2', 'cm2x m2', … with their signs."""
    basis = columns()
    prime = {value: name for name, value in LENGTHS.items()}
    beta: list[dict[str, int]] = [{} for _ in basis]
    for link, (rotation, origin) in link_frames().items():
        for name, direction in [("m", origin), *zip("xyz", rotation.T, strict=True)]:
            for k, value in enumerate(coordinates(torque_of_height(direction), basis)):
                if value:
                    factor = prime[abs(value)] if name == "m" else f"cm{link}{name}"
                    beta[k][f"{factor} m{link}"] = 1 if value > 0 else -1
    return beta


def parse_beta(text: str) -> dict[str, int]:
    """Return the signed terms of a printed base parameter."""
    terms = re.split(r" (?=[+-] )", text)
    return {t.removeprefix("+ ").removeprefix("- "): -1 if t[0] == "-" else 1 for t in terms}


def parallelogram_readings() -> dict[str, list[str]]:
    """Return which frames of links 4' and 5' reproduce the printed beta.

    Tried are all right-handed frames whose axes lie along those of the arm or of the forearm,
    turning with it, with the origin at the shoulder, the elbow or either end of the bar.
    """
    placed = frames()
    basis = [vertical(c) for c in columns()[:4]]
    (_, shoulder), (arm, elbow), (forearm, _) = placed[1:4]
    side = LENGTHS["l'_forearm"] * forearm[:, 0]
    origins = {
        "shoulder": shoulder,
        "elbow": elbow,
        "crank's tip": shoulder + side,
        "bar's end on the forearm": elbow + side,
    }
    wanted = {"4'": [[0, 0, 7, 0], [-1, 0, 0, 0], [0, -1, 0, 0]]}
    wanted["5'"] = [[0, 0, 7, 0], [0, 0, 0, 1], [0, 0, -1, 0]]
    found: dict[str, list[str]] = {"4'": [], "5'": []}
    attempts = 0
    for (body, axes), (name, origin) in itertools.product(
        (("2", arm), ("3", forearm)), origins.items()
    ):
        mass = coordinates(vertical(torque_of_height(origin)), basis)
        for order in itertools.permutations(range(3)):
            for signs in itertools.product((1, -1), repeat=3):
                matrix = np.zeros((3, 3))
                matrix[list(order), range(3)] = signs
                if np.linalg.det(matrix) < 0:
                    continue
                attempts += 1
                seen = [vertical(torque_of_height(axes[:, order[k]] * signs[k])) for k in range(3)]
                moments = [coordinates(c, basis) for c in seen]
                text = ", ".join(
                    f"{'xyz'[k]} = {'-' if signs[k] < 0 else ''}{'xyz'[order[k]]}{body}"
                    for k in range(3)
                )
                for link, expected in wanted.items():
                    if [mass, *moments[:2]] == expected and not any(moments[2]):
                        found[link].append(f"origin at the {name}; {text}")
    found["tried"] = [str(attempts)]
    return found


def verdict(row: int, k: int, derived: Any) -> str:
    """Return what is wrong with a printed entry, in words; nothing if it is right."""
    text = PRINTED[row].get(k)
    if text is None:
        return "missing"
    try:
        if parse(text) == derived:
            return ""
    except ValueError:
        pass
    mended = MENDED.get((row, k))
    if mended is not None and parse(mended) == derived:
        return f"brackets lost; read {_math(mended)}"
    return "wrong"


def _math(text: str) -> str:
    """Return an entry in plain characters for a Markdown table."""
    return re.sub(r"[_{}]", "", text).replace("s23", "S").replace("c23", "C")


def rows_table() -> str:
    """Return the Markdown table of the entries that are printed or are not zero."""
    derived = [vertical(c) for c in columns()[:10]]
    lines = ["| entry | printed | derived | |", "|---|---|---|---|"]
    for row in JOINTS:
        for k in range(1, 11):
            entry = derived[k - 1][row - 1]
            if parse(SHORT[row][k - 1]) != entry:
                raise ValueError(f"short form of Y{row},{k} is not the derived one")
            remark = verdict(row, k, entry)
            if entry or remark not in ("", "missing"):
                shown = _math(PRINTED[row].get(k, "—"))
                lines.append(f"| Y{row},{k} | {shown} | {_math(SHORT[row][k - 1])} | {remark} |")
        zeros = [k for k in range(1, 11) if not derived[k - 1][row - 1]]
        if zeros:
            count = sum(k in PRINTED[row] for k in zeros)
            span = f"Y{row},{zeros[0]}…{zeros[-1]}"
            remark = f"{len(zeros) - count} missing"
            lines.append(f"| {span} | zeros: {count} | zeros: {len(zeros)} | {remark} |")
    return "\n".join(lines)


def beta_table() -> str:
    """Return the Markdown table of beta: printed terms, and those to add or to strike."""
    lines = ["| | printed | add | strike |", "|---|---|---|---|"]

    def joined(terms: dict[str, int]) -> str:
        text = " ".join(f"{'-' if sign < 0 else '+'} {term}" for term, sign in terms.items())
        return text.removeprefix("+ ") or "—"

    for k, derived in enumerate(derived_beta(), start=1):
        printed = parse_beta(PRINTED_BETA[k - 1]) if k <= 10 else {}
        add = {t: s for t, s in derived.items() if printed.get(t) != s}
        strike = {t: s for t, s in printed.items() if derived.get(t) != s}
        lines.append(f"| β{k} | {joined(printed)} | {joined(add)} | {joined(strike)} |")
    return "\n".join(lines)


def figures_table() -> str:
    """Return the Markdown table of ranks and of the distance to ``dvrk_gravity.gravity``."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (1000, 7))
    lines = [
        "| gravity | columns | rank | closed form minus derivation, largest |",
        "|---|---|---|---|",
    ]
    derived = columns()
    for name, gravity in (("vertical", (0.0, 0.0, -9.81)), ("tilted", (1.0, -2.0, -9.55))):
        values = [np.cos(q.T), np.sin(q.T)]
        up = np.outer(np.divide(gravity, -9.81), np.ones(len(q)))
        arguments = [*values[0], *values[1], *up]
        flat = [entry.as_expr() for column in derived for entry in column]
        function = sympy.lambdify([g.as_expr() for g in GENERATORS], flat, cse=True)
        exact = np.array([np.broadcast_to(v, len(q)) for v in function(*arguments)])
        exact = exact.reshape(14, 7, -1).transpose(2, 1, 0)
        for count in (10, 12, 14):
            y = regressor(q, gravity, count)
            rank = np.linalg.matrix_rank(y.reshape(-1, count))
            distance = abs(y - exact[..., :count]).max()
            lines.append(f"| {name} | {count} | {rank} | {distance:.0e} |")
    return "\n".join(lines)


def main() -> None:
    """Print every table of docs/gravity_model.md."""
    print(rows_table(), beta_table(), figures_table(), sep="\n\n")
    for link, readings in parallelogram_readings().items():
        print(f"\n{link}: {'; or '.join(readings)}")


if __name__ == "__main__":
    main()
