"""A page in Chromium: its width, its scheme, what it writes to the console, what is measured in it.

Chromium is no Python package; it is driven over its own protocol, which needs no driver.
"""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM = next((path for path in map(shutil.which, NAMES) if path), None)

# Texts whose contrast with their ground is below 4.5 (WCAG 2.2, 1.4.3), of all that is shown.
_PALE = """
(() => {
  const channels = text => (text.match(/[\\d.]+/g) || []).map(Number);
  const light = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map(c => {
      c /= 255;
      return c <= .04045 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4;
    });
    return .2126 * x + .7152 * y + .0722 * z;
  };
  const ground = element => {
    for (let e = element; e; e = e.parentElement) {
      if (e.tagName === 'g' && e.firstElementChild !== element && e.classList.contains('joint'))
        return channels(getComputedStyle(e.firstElementChild).fill);
      const c = channels(getComputedStyle(e).backgroundColor);
      if (c.length === 3 || c[3] > 0) return c;
    }
    return [255, 255, 255];
  };
  const found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || !element.checkVisibility()) continue;
    const style = getComputedStyle(element);
    const own = channels(element.closest('svg') ? style.fill : style.color);
    const [a, b] = [light(own), light(ground(element))].sort((x, y) => y - x);
    const contrast = (a + .05) / (b + .05);
    if (contrast < 4.5) found.push(`${walk.currentNode.data.trim()}: ${contrast.toFixed(2)}`);
  }
  return found;
})()
"""


class Browser:
    """One tab of Chromium."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection, self._sent = connection, 0
        self.errors: list[str] = []  # of the console, since the last page was opened
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def open(self, page: Path, width: int, dark: bool = False, medium: str = "screen") -> None:
        """Show a page on a screen, or in print, of a width, px, and wait until it is loaded."""
        self.errors.clear()
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=900,
                   deviceScaleFactor=1, mobile=width < 600)  # fmt: skip
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._call("Emulation.setEmulatedMedia", media=medium, features=[scheme])
        self._call("Page.navigate", url=page.resolve().as_uri())
        while self._received().get("method") != "Page.loadEventFired":
            pass

    def value(self, script: str) -> Any:
        """Return what a script evaluates to."""
        answer = self._call("Runtime.evaluate", expression=script, returnByValue=True)
        return answer["result"].get("value")

    def overflow(self) -> int:
        """Return by how many px the page is broader than its window."""
        return int(self.value("document.documentElement.scrollWidth - innerWidth"))

    def pale_texts(self) -> list[str]:
        """Return the shown texts that are hard to read on their ground, with their contrast."""
        return list(self.value(_PALE))

    def unfold(self) -> None:
        """Open all that is folded."""
        self.value("for (const e of document.querySelectorAll('details')) e.open = true")

    def screenshot(self, path: Path) -> None:
        """Write a PNG of the whole page."""
        image = self._call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        path.write_bytes(base64.b64decode(image))

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": parameters}
        self._connection.send(json.dumps(message))
        while (answer := self._received()).get("id") != self._sent:
            pass
        assert "error" not in answer, answer
        return dict(answer["result"])

    def _received(self) -> dict[str, Any]:
        message = json.loads(self._connection.recv(timeout=30))
        method, parameters = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(parameters["exceptionDetails"]["text"])
        if method == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.errors.append(parameters["entry"]["text"])
        return dict(message)


@contextmanager
def chromium(profile: Path) -> Iterator[Browser]:
    """Run Chromium without a window, with a profile in an empty folder."""
    assert CHROMIUM is not None
    process = subprocess.Popen(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
         "--hide-scrollbars", "--remote-debugging-port=0", f"--user-data-dir={profile}"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        port = profile / "DevToolsActivePort"
        ends = time.monotonic() + 30.0
        while not port.is_file() or not port.read_text().strip():
            assert process.poll() is None, "Chromium has ended"
            assert time.monotonic() < ends, "Chromium does not start"
            time.sleep(0.02)
        address = f"http://127.0.0.1:{port.read_text().splitlines()[0]}/json/list"
        with urlopen(address, timeout=30) as answer:
            tab = next(each for each in json.load(answer) if each["type"] == "page")
        with connect(tab["webSocketDebuggerUrl"], max_size=None, proxy=None) as connection:
            yield Browser(connection)
    finally:
        process.terminate()
        process.wait(30)
