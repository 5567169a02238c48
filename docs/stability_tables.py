"""Write the tables of docs/stability.md from what is public: names, options, topics, findings.

``python docs/stability_tables.py`` prints them; ``--write`` puts them into the page, whose changes
then show what users of the package would notice.
"""

from __future__ import annotations

import argparse
import inspect
import pkgutil
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.effects import effects

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = Path(__file__).resolve().with_name("stability.md")
PYTHON = (
    "Arm.load", "Arm.from_urdf", "TorqueModel.load", "TorqueModel.save", "TorqueModel.torque",
    "Recording", "Recording.load", "Recording.save", "Recording.to_dataframe", "identify",
    "evaluate", "diagnose", "gravity.regressor", "identification:Fit", "identification:Evaluation",
    "diagnosis:Diagnosis", "diagnosis:Finding", "diagnosis:build", "diagnosis:infer",
    "diagnosis:Hypotheses.about", "diagnosis:report", "planning:Multisine.draw",
    "planning:design_motion",
    "planning:PlanLimits.of", "planning:MotionDesign", "simulate:PlantFile.load",
    "simulate:PlantFile.of",
    "simulate:PlantFile.plant", "simulate:SimulatedArm", "simulate:simulate",
    "simulate:record_motion", "simulate:record_poses", "errors:DvrkGravityError",
    "errors:ConfigError", "errors:RecordingError",
)  # fmt: skip
# Results: their attributes are public; they are made by the functions above.
RESULTS = ("Fit", "Evaluation", "Diagnosis", "Finding", "MotionDesign", "DvrkGravityError",
           "ConfigError", "RecordingError")  # fmt: skip
# Every node of rclpy has these.
OF_RCLPY = ("parameter_events", "rosout", "parameters", "parameter_types", "type_description",
            "set_parameters_atomically")  # fmt: skip
# What the compensator only listens to, to find out who else commands the arm.
HEARD = re.compile(r".*/?(servo_|move_|interpolate_|set_|lock_|unlock_|state_c|setpoint_)\S*")


def tables() -> dict[str, str]:
    """Return the tables in Markdown, by the name of their place in the page."""
    return {
        "python": _table(("name", "arguments, or attributes of a result"), _python()),
        "commands": _table(("verb", "arguments"), _commands()),
        "topics": _table(("node", "publishes", "subscribes", "services"), _topics()),
        "findings": _table(("finding", "what it is"), _findings()),
    }


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _python() -> Iterable[tuple[str, str]]:
    for name in PYTHON:
        room, _, rest = name.rpartition(":")
        found = pkgutil.resolve_name(f"dvrk_gravity{'.' if room else ''}{room}:{rest}")
        if rest in RESULTS:
            listed = _attributes(found)
        else:
            listed = [each for each in inspect.signature(found).parameters if each != "self"]
        yield f"`dvrk_gravity.{f'{room}.' if room else ''}{rest}`", _quoted(listed)


def _attributes(result: type) -> list[str]:
    if issubclass(result, Exception):
        return []
    methods = [name for name in ("to_json", "to_dict", "to_dataframe") if hasattr(result, name)]
    return [each.name for each in fields(result)] + [f"{name}()" for name in methods]


def _commands() -> Iterable[tuple[str, str]]:
    for verb, (target, _) in VERBS.items():
        parser = argparse.ArgumentParser(add_help=False)
        pkgutil.resolve_name(target).add_arguments(parser)
        # A flag has two names, --physical and --no-physical.
        words = [action.option_strings or [action.dest.upper()] for action in parser._actions]
        options = [option for each in words for option in each]
        yield f"`{verb}`", _quoted(options) or "`--ros-args`: [parameters](parameters.md)"


def _topics() -> Iterable[tuple[str, ...]]:
    policy = ElementTree.parse(REPOSITORY / "config" / "security" / "mtmr.policy.xml")
    for profile in policy.iter("profile"):
        found: dict[str, list[str]] = {"publish": [], "subscribe": [], "reply": []}
        for group in profile:
            for kind, names in found.items():
                if group.get(kind) == "ALLOW":
                    names += [(entry.text or "").strip() for entry in group]
        if profile.get("node") == "compensator":
            found["subscribe"] = [name for name in found["subscribe"] if not HEARD.match(name)]
        own = (filter(_of_the_package, names) for names in found.values())
        yield f"`{profile.get('node')}`", *map(_quoted, own)


def _of_the_package(name: str) -> bool:
    return not name.endswith(OF_RCLPY)


def _findings() -> Iterable[tuple[str, str]]:
    for effect in effects():
        yield f"`{effect.NAME}`", effect.title()


def written() -> str:
    """Return the page with its tables renewed."""
    text = PAGE.read_text(encoding="utf-8")
    for name, table in tables().items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        head, rest = text.split(begin)
        text = f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="renew the page")
    if parser.parse_args().write:
        PAGE.write_text(written(), encoding="utf-8")
    else:
        print("\n\n".join(tables().values()))
