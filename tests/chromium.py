"""A headless Chromium spoken to over its debugging pipe: no network, no driver package."""

from __future__ import annotations

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

PATH = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-default-apps --disable-extensions --hide-scrollbars "
    "--remote-debugging-pipe"
)
_PATIENCE_S = 60.0


class Browser:
    """One page. ``problems`` collects errors, exceptions and policy violations, ``requests`` addresses."""

    def __init__(self, profile: Path) -> None:
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        script = f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'
        command = [
            "bash",
            "-c",
            script,
            str(PATH),
            *_FLAGS.split(),
            f"--user-data-dir={profile}",
            "about:blank",
        ]
        self._process = subprocess.Popen(
            command, pass_fds=(to_browser, from_browser), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number = itertools.count(1)
        self._buffer = b""
        self._session = ""
        self.problems: list[str] = []
        self.requests: list[str] = []
        self._attach()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_error: object) -> None:
        try:
            self.send("Browser.close", {}, session="")
        except (OSError, TimeoutError):
            self._process.kill()
        self._process.wait(timeout=20)
        os.close(self._write)
        os.close(self._read)

    def _attach(self) -> None:
        """Find the page and listen to it."""
        targets = self.send("Target.getTargets", {}, session="")["targetInfos"]
        page = next(target for target in targets if target["type"] == "page")
        wanted = {"targetId": page["targetId"], "flatten": True}
        self._session = self.send("Target.attachToTarget", wanted, session="")["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, values: dict[str, Any] | None = None, session: str | None = None) -> Any:
        """Run one command and return its result; note what happens meanwhile."""
        number = next(self._number)
        message: dict[str, Any] = {"id": number, "method": method, "params": values or {}}
        if session is None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + _PATIENCE_S
        while True:
            answer = self._next(until)
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self._note(answer)

    def _next(self, until: float) -> dict[str, Any]:
        """Return the browser's next message."""
        while b"\0" not in self._buffer:
            if not select.select([self._read], [], [], max(0.0, until - time.monotonic()))[0]:
                raise TimeoutError("the browser does not answer")
            self._buffer += os.read(self._read, 1 << 20)
        line, _, self._buffer = self._buffer.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        """Keep what a user would see in the console, and what was requested."""
        method, values = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.problems.append(json.dumps(values["exceptionDetails"])[:400])
        elif method == "Runtime.consoleAPICalled" and values["type"] in {"error", "warning", "assert"}:
            self.problems.append(json.dumps(values["args"])[:400])
        elif method == "Log.entryAdded" and values["entry"]["level"] in {"error", "warning"}:
            self.problems.append(values["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"][:200])

    def show(self, width: int, *, dark: bool = False, media: str = "screen") -> None:
        """Set the window's width [px], the colour scheme and the medium."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.send("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", {"media": media, "features": [scheme]})

    def open(self, path: Path) -> None:
        """Open a file and wait until it is loaded; what was noted before is forgotten."""
        self.go(path.as_uri())

    def go(self, url: str) -> None:
        """Open an address and wait until it is loaded; what was noted before is forgotten."""
        self.problems.clear()
        self.requests.clear()
        self.send("Page.navigate", {"url": url})
        self.run(
            "new Promise((done) => document.readyState === 'complete' ? done() "
            ": addEventListener('load', done))"
        )

    def run(self, script: str) -> Any:
        """Return the value of an expression or of a promise in the page."""
        values = {"expression": script, "awaitPromise": True, "returnByValue": True}
        answer = self.send("Runtime.evaluate", values)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str, longest_s: float = _PATIENCE_S) -> Any:
        """Wait until an expression in the page is true, and return its value; pages may come and go."""
        until = time.monotonic() + longest_s
        while time.monotonic() < until:
            try:
                if found := self.run(condition):
                    return found
            except (AssertionError, RuntimeError):
                pass
            time.sleep(0.1)
        raise TimeoutError(f"never true: {condition}")

    def place(self, selector: str) -> tuple[float, float]:
        """Scroll an element into view and return its middle."""
        box = self.run(
            f"(() => {{ const it = document.querySelector({json.dumps(selector)}); "
            "it.scrollIntoView({block: 'center', behavior: 'instant'}); "
            "const box = it.getBoundingClientRect(); "
            "return [box.x + box.width / 2, box.y + box.height / 2]; })()"
        )
        return float(box[0]), float(box[1])

    def click(self, selector: str) -> None:
        """Press and release the mouse on an element."""
        x, y = self.place(selector)
        for kind in ("mousePressed", "mouseReleased"):
            event = {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1}
            self.send("Input.dispatchMouseEvent", event)

    def key(self, name: str) -> None:
        """Press and release a key, as Tab or Enter."""
        code = {"Tab": 9, "Enter": 13, "Space": 32, "ArrowDown": 40}[name]
        text = {"Enter": "\r", "Space": " "}.get(name, "")
        key = " " if name == "Space" else name
        values = {"key": key, "code": name, "windowsVirtualKeyCode": code}
        self.send("Input.dispatchKeyEvent", {"type": "keyDown", "text": text, **values})
        self.send("Input.dispatchKeyEvent", {"type": "keyUp", **values})

    def drop(self, files: list[Path], selector: str = "body") -> None:
        """Drag files from outside onto an element and let them go."""
        # Before the page's scripts have run, nobody would catch them.
        self.wait("document.readyState === 'complete'")
        x, y = self.place(selector)
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.send("Input.dispatchDragEvent", {"type": kind, "x": x, "y": y, "data": data})

    def choose(self, files: list[Path], selector: str) -> None:
        """Choose files in a file input, as the system's dialogue does."""
        script = f"document.querySelector({json.dumps(selector)})"
        node = self.send("Runtime.evaluate", {"expression": script})
        values = {"files": [str(file) for file in files], "objectId": node["result"]["objectId"]}
        self.send("DOM.setFileInputFiles", values)

    def picture(self, path: Path) -> None:
        """Write a picture of the whole page."""
        answer = self.send("Page.captureScreenshot", {"captureBeyondViewport": True})
        path.write_bytes(base64.b64decode(answer["data"]))

    def pdf(self) -> bytes:
        """Print the page."""
        return base64.b64decode(self.send("Page.printToPDF", {"printBackground": True})["data"])
