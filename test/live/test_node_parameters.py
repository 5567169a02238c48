"""``get`` and ``set`` on running nodes, and what a compensator of a simulated arm advises."""

from __future__ import annotations

from rcl_interfaces.srv import GetParameters
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess

SPACE = f"{PRIVATE}/lab"
NODE = f"{SPACE}/compensator"


def test_parameters_of_a_running_node_are_read_and_set(domain, capsys):
    def ask(*words: str) -> tuple[int, str]:
        status = main([*words, "--timeout", "1" if "/nobody" in words else "60"])
        said = capsys.readouterr()
        return status, (said.out + said.err).strip()

    with NodeProcess("compensator", "--params-file", str(MODEL_FILE), namespace=SPACE):
        assert ask("get", NODE, "timeout") == (0, "timeout: 0.1")
        assert ask("set", NODE, "timeout", "1") == (0, f"{NODE}: timeout: 1.0")
        assert ask("set", NODE, "resume", "automatic") == (0, f"{NODE}: resume: automatic")
        assert "timeout: 1.0\n" in ask("get", NODE)[1]
        refused = ask("set", NODE, "timeout", "7")
        assert refused[0] == 1
        assert "refuses timeout" in refused[1]
        for words, named in (
            (("get", NODE, "timeou"), "timeout"),
            (("set", NODE, "timeou", "1"), "timeout"),
            (("get", "/nobody"), NODE),
            (("set", NODE, "timeout", "{a: 1}"), "VALUE"),
        ):
            status, said = ask(*words)
            assert status == 2
            assert named in said
            assert said.count("\n") == 0


def test_what_only_reads_is_asked_again_where_a_response_is_lost(domain):
    asked = []

    def answer(request: GetParameters.Request, response: GetParameters.Response) -> object:
        asked.append(request)
        return response

    with Client(f"{PRIVATE}/lossy") as client:
        service = client.node.create_service(GetParameters, "lossy", answer)
        send = service.send_response

        def lose_the_first(*response: object) -> None:
            if len(asked) > 1:
                send(*response)

        service.send_response = lose_the_first
        assert client.call(GetParameters, "lossy", only_reads=True).values == []
        assert len(asked) == 2
