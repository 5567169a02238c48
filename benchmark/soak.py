"""A long run at 1 kHz: latency over time, memory, processor, losses; a picture and JSON.

    PYTHONPATH=. python benchmark/soak.py [--minutes M] [--out DIR] [--json FILE]

Every five seconds: median, 99th percentile and maximum of the round trip, messages without an
answer, resident memory and processor time of the compensator. Memory is judged over the last ten
minutes of a run of twenty or more: not a byte may be added. Python and DDS take what they keep in
about ten minutes; in a shorter run the second half may add the few pages that belong to that.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from round_trip import RoundTrip
from units import processor_time

from dvrk_gravity.files import text_file
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, private_domain

MODEL = Path(__file__).resolve().parents[1] / "config" / "mtmr_28002.yaml"
BLOCK = 5.0  # s
JUDGED = 10.0  # minutes at the end of a full run
WARMING_UP = 64.0  # kB that the second half of a shorter run may add


def resident(pid: int) -> int:
    """Return a process's resident memory, bytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGESIZE")


def soak(minutes: float) -> dict[str, list[float]]:
    """Run; return columns, a row every :data:`BLOCK` seconds."""
    columns: dict[str, list[float]] = {
        name: [] for name in ("time_s", "p50_us", "p99_us", "max_us", "sent", "lost",
                              "resident_kB", "processor_percent")
    }  # fmt: skip
    with (
        private_domain(),
        Client() as client,
        NodeProcess("compensator", "--params-file", str(MODEL), "-p", "timeout:=1.0",
                    "-p", "resume:=automatic", "-p", "await_watchdog:=0.0") as node,
    ):  # fmt: skip
        trip = RoundTrip(client, PRIVATE)
        trip.connect()
        pid = node.process.pid
        begin = time.monotonic()
        while time.monotonic() - begin < 60.0 * minutes:
            start, used = time.monotonic(), processor_time(pid)
            trip.run(BLOCK)
            times, lost = trip.take()
            elapsed = time.monotonic() - start
            p50, p99, longest = np.percentile(times, (50, 99, 100)) * 1e6
            share = 100.0 * (processor_time(pid) - used) / elapsed
            row = (start - begin, p50, p99, longest, len(times) + lost, lost,
                   resident(pid) / 1024, share)  # fmt: skip
            for column, value in zip(columns.values(), row, strict=True):
                column.append(float(value))
        if not is_well(node):
            raise SystemExit(f"the compensator said: {node.lines[-5:]}")
    return columns


def is_well(node: NodeProcess) -> bool:
    """Tell whether the node is still there and has not stumbled."""
    return node.process.poll() is None and "Traceback" not in node.output


def grown(columns: dict[str, list[float]], minutes: float) -> float:
    """Return what the last minutes of a run have added to the resident memory, kB."""
    time_s, memory = np.array(columns["time_s"]), columns["resident_kB"]
    first = int(np.searchsorted(time_s, time_s[-1] - 60.0 * minutes))
    return memory[-1] - memory[first]


def draw(columns: dict[str, list[float]], path: Path) -> None:
    """Draw latency, losses, memory and processor over time."""
    figure, axes = plt.subplots(4, 1, figsize=(9, 9), sharex=True, layout="constrained")
    minutes = np.array(columns["time_s"]) / 60.0
    for name, label in (("p50_us", "median"), ("p99_us", "99 %"), ("max_us", "longest")):
        axes[0].semilogy(minutes, columns[name], label=label)
    axes[0].set_ylabel("round trip, µs")
    axes[0].legend()
    axes[1].plot(minutes, columns["lost"])
    axes[1].set_ylabel(f"no answer, of {BLOCK:g} s")
    axes[2].plot(minutes, np.array(columns["resident_kB"]) / 1024.0)
    axes[2].set_ylabel("resident memory, MB")
    axes[3].plot(minutes, columns["processor_percent"])
    axes[3].set_ylabel("processor, % of a core")
    axes[3].set_xlabel("minutes")
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main() -> int:
    """Run, print the summary; status 1 if memory grows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=2.0, help="30 for the full run")
    parser.add_argument("--out", type=Path, default=Path("out/soak"), help="folder of the picture")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to FILE")
    arguments = parser.parse_args()
    columns = soak(arguments.minutes)
    arguments.out.mkdir(parents=True, exist_ok=True)
    draw(columns, arguments.out / "soak.png")
    full = arguments.minutes >= 2.0 * JUDGED
    judged = JUDGED if full else arguments.minutes / 2.0
    growth = grown(columns, judged)
    sent, lost = sum(columns["sent"]), sum(columns["lost"])
    print(f"{arguments.minutes:g} minutes at 1 kHz: {sent:.0f} sent, {lost:.0f} without answer "
          f"({100 * lost / sent:.3f} %)")  # fmt: skip
    print(f"round trip: median {np.median(columns['p50_us']):.0f} µs, 99 % "
          f"{np.median(columns['p99_us']):.0f} µs (of blocks: worst {max(columns['p99_us']):.0f}), "
          f"longest {max(columns['max_us']):.0f} µs")  # fmt: skip
    print(f"memory: {columns['resident_kB'][-1] / 1024:.1f} MB, {growth:.0f} kB added in the last "
          f"{judged:g} minutes, {grown(columns, arguments.minutes):.0f} kB in all; "
          f"processor: {np.mean(columns['processor_percent']):.0f} % of a core")  # fmt: skip
    print(f"picture: {arguments.out / 'soak.png'}")
    summary = {"sent": sent, "lost": lost, "growth_kB": growth, "rows": columns}
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(summary, indent=1) + "\n")
    return 0 if growth <= (0.0 if full else WARMING_UP) else 1


if __name__ == "__main__":
    sys.exit(main())
