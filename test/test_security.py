"""What the nodes may do is written down exactly; what comes in files is never executed."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import pytest
from recording_samples import wave
from support import CONFIG, MODEL_FILE, REPOSITORY, syntax

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.recording import BagReader
from dvrk_gravity.ros import COMMANDS, PRIVATE, UNHEARD, NodeProcess, OperatingState

POLICIES = {arm: CONFIG / "security" / f"{arm}.policy.xml" for arm in ("mtml", "mtmr")}
ACCESS = {"topics": ("publish", "subscribe"), "services": ("reply", "request")}
NODES = {
    "compensator": ("--params-file", str(MODEL_FILE)),
    "watchdog": (),
    "simulator": ("-p", "builtin_gravity_compensation:=false"),
}


# Whose types come with the dVRK's workspace: not subscribed to without it.
OF_THE_WORKSPACE = {*UNHEARD, "operating_state"} - {
    "operating_state" if OperatingState is not None else ""
}
ARRAY = CONFIG / "security" / "effort_controller.policy.xml"


def allowed(policy: str, node: str) -> dict[str, set[str]]:
    """What a policy lets a node do: full names, by kind of access."""
    profiles = ElementTree.fromstring(policy).iter("profile")
    (profile,) = (item for item in profiles if item.get("node") == node)
    namespace = profile.get("ns")
    names: dict[str, set[str]] = {}
    for group in profile:
        (access,) = (kind for kind in ACCESS[group.tag] if group.get(kind) == "ALLOW")
        for item in group:
            text = (item.text or "").strip()
            if text in OF_THE_WORKSPACE:
                continue
            full = text if text.startswith("/") else f"{namespace}/{text}"
            names.setdefault(access, set()).add(full.replace("/~/", f"/{node}/"))
    return names


@pytest.mark.parametrize("output", ["servo_jf", "array"])
@pytest.mark.parametrize("verb", NODES)
def test_the_policy_allows_exactly_what_the_node_does(arm, verb, output):
    node = arm.client.node
    if output == "array":
        policy = ARRAY.read_text(encoding="utf-8").replace("/ARM", PRIVATE)
    else:  # the one of another namespace is made as docs/reliability.md says
        policy = POLICIES["mtml"].read_text(encoding="utf-8").replace("/MTML", PRIVATE)
    used: dict[str, set[str]] = {}

    def complete() -> bool:
        """Whether all that the policy allows is there; what is there beyond it is judged below."""
        if (verb, PRIVATE) not in node.get_node_names_and_namespaces():
            return False
        for access, ask in (
            ("publish", node.get_publisher_names_and_types_by_node),
            ("subscribe", node.get_subscriber_names_and_types_by_node),
            ("reply", node.get_service_names_and_types_by_node),
            ("request", node.get_client_names_and_types_by_node),
        ):
            # Gathered over time: the compensator listens for others only until it commands.
            used.setdefault(access, set()).update(name for name, _ in ask(verb, PRIVATE))
        return all(names <= used[access] for access, names in granted.items())

    granted = allowed(policy, verb)
    with NodeProcess(verb, *NODES[verb], "-p", f"output:={output}"):
        arm.run_until(complete, f"all that the policy of {verb} allows")
        arm.run(0.3)  # the compensator commands by now
        complete()
    assert {access: names for access, names in used.items() if names} == granted


def test_the_policies_of_both_arms_differ_in_nothing_but_the_name():
    left, right = (path.read_text(encoding="utf-8") for path in POLICIES.values())
    assert left.replace("MTML", "MTMR") == right


def test_no_policy_allows_a_pattern():
    for path in (*POLICIES.values(), ARRAY):
        for item in ElementTree.parse(path).getroot().iter():
            assert not set(item.text or "") & set("*?[")


FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "literal_eval"}
FORBIDDEN_MODULES = {"pickle", "cPickle", "shelve", "marshal", "dill", "joblib"}


def suspicious(nodes: Iterable[ast.AST]) -> list[str]:
    """Return what in a module could execute what a file holds."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
            found += [name for name in names if name.split(".")[0] in FORBIDDEN_MODULES]
        if isinstance(node, ast.Call):
            called = node.func
            owner = called.value.id if (
                isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name)
            ) else ""  # fmt: skip
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            given = {word.arg: ast.unparse(word.value) for word in node.keywords}
            if name in FORBIDDEN_CALLS and owner != "re":
                found.append(name)
            if owner == "yaml" and "load" in name and given.get("Loader") != "_Loader":
                found.append(f"yaml.{name}")
            if given.get("allow_pickle", "False") != "False" or given.get("shell") == "True":
                found.append(ast.unparse(node))
    return found


def test_no_module_executes_what_a_file_holds():
    found = {path: suspicious(syntax(path)) for path in (REPOSITORY / "dvrk_gravity").rglob("*.py")}
    assert found
    assert not {path: calls for path, calls in found.items() if calls}


@pytest.mark.parametrize(
    "line",
    ["eval(text)", "import pickle", "from pickle import load", "yaml.load(text)", "os.system(x)",
     "yaml.load(text, Loader=yaml.Loader)", "np.load(f, allow_pickle=True)", "yaml.unsafe_load(x)",
     "subprocess.run(x, shell=True)", "builtins.exec(x)"],
)  # fmt: skip
def test_the_search_finds_what_it_looks_for(line):
    assert suspicious(ast.walk(ast.parse(line)))


def test_the_yaml_loader_in_use_is_a_safe_one():
    import yaml

    from dvrk_gravity.files import yaml_file

    # What constructs objects; FullConstructor, which is a kind of it, makes any of Python's.
    assert issubclass(yaml_file._Loader, yaml.constructor.SafeConstructor)
    assert not issubclass(yaml_file._Loader, yaml.constructor.FullConstructor)


def test_an_arm_s_name_does_not_lead_out_of_the_package_s_files(tmp_path, monkeypatch):
    inside = tmp_path / "share" / "dvrk_gravity" / "config" / "arms"
    inside.mkdir(parents=True)
    source = (CONFIG / "arms" / "mtmr.yaml").read_bytes()
    (inside / "mine.yaml").write_bytes(source)
    (tmp_path / "share" / "outside.yaml").write_bytes(source)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert Arm.load("mine").name == "mtmr"
    for name in ("../../../outside", str(tmp_path / "share" / "outside"), "mtmr\0", ""):
        with pytest.raises(ConfigError):
            Arm.load(name)


def test_a_bag_s_metadata_does_not_lead_out_of_its_folder(tmp_path):
    wave(50).save(tmp_path / "bag")
    (data,) = (tmp_path / "bag").glob("*.db3")
    data.rename(tmp_path / "elsewhere.db3")
    metadata = tmp_path / "bag" / "metadata.yaml"
    text = metadata.read_text(encoding="utf-8")
    for path in ("../elsewhere.db3", str(tmp_path / "elsewhere.db3")):
        metadata.write_text(text.replace(data.name, path), encoding="utf-8")
        with pytest.raises(RecordingError), BagReader(tmp_path / "bag"):
            pass


# What may publish, and what: commands go through the arm's link, holds through what repeats them.
ELSEWHERE = {
    "ros/arm_link.py": "the commands",
    "ros/hold.py": "hold, until it has arrived",
    "ros/simulator_node.py": "what an arm measures",
    "cli/replay.py": "what a bag has measured, to a node of its own",
}


def test_nothing_but_the_arm_s_link_publishes_a_motion_command():
    commands = {name for name, _ in COMMANDS} | {*UNHEARD}
    package = REPOSITORY / "dvrk_gravity"
    found = []
    for path in sorted(package.rglob("*.py")):
        for node in syntax(path):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            if node.func.attr != "create_publisher":
                continue
            where, topic = str(path.relative_to(package)), node.args[1]
            if isinstance(topic, ast.Constant):
                assert topic.value not in commands, f"{where} publishes {topic.value}"
            elif not (isinstance(topic, ast.Name) and topic.id == "TIMEOUT_TOPIC"):
                assert where in ELSEWHERE, f"{where} publishes {ast.unparse(topic)}"
                found.append(where)
    assert {*found} == {*ELSEWHERE}
