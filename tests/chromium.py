"""A headless Chromium that tests drive through the DevTools protocol, over a pipe."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

ARGUMENTS = (
    "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe", "--disable-gpu-sandbox", "--hide-scrollbars", "--force-color-profile=srgb",
)  # fmt: skip


def find_chromium() -> str | None:
    """Return the program, or None."""
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    return next((each for each in found if each), None)


class Chromium:
    """One browser with one tab; a context manager.

    Attributes
    ----------
    errors : list of str
        What the page's console called an error, and exceptions that nobody caught.
    requests : list of str
        Addresses that the page asked for.
    """

    def __init__(self, profile: Path, *arguments: str) -> None:
        from_us, to_us = os.pipe(), os.pipe()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._number = 0
        self._rest = b""
        command = [str(find_chromium()), *ARGUMENTS, *arguments, f"--user-data-dir={profile}", "about:blank"]
        pipes = f'exec "$0" "$@" 3<&{from_us[0]} 4>&{to_us[1]}'
        self._process = subprocess.Popen(
            ["/bin/bash", "-c", pipes, *command],
            pass_fds=(from_us[0], to_us[1]), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(from_us[0])
        os.close(to_us[1])
        self._write, self._read = from_us[1], to_us[0]
        tabs = self._call("Target.getTargets")["targetInfos"]
        tab = next(each["targetId"] for each in tabs if each["type"] == "page")
        self._session = self._call("Target.attachToTarget", targetId=tab, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Chromium:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(20)
        os.close(self._write)
        os.close(self._read)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the tab."""
        return self._call(method, self._session, **parameters)

    def open(self, address: str, width: int = 800, height: int = 600, phone: bool = False) -> None:
        """Load a page in a window of this size, and wait until its object stands or has failed."""
        device = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **device)
        self.call("Page.navigate", url=address)
        look = "const look = () => document.readyState === 'complete' ? done() : setTimeout(look, 50);"
        self.evaluate(f"new Promise(done => {{ {look} look(); }})")
        self.evaluate("window.ibrpipe ? window.ibrpipe.ready.catch(() => 0) : 0")

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression, waiting for a promise."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"].get("exception", answer["exceptionDetails"]))
        return answer["result"].get("value")

    def render(self, camera: Any, **options: Any) -> np.ndarray:
        """(H, W, 4) uint8: what ``window.ibrpipe.render`` returns of a camera."""
        asked = {"K": camera.K.tolist(), "cam_from_world": camera.cam_from_world.tolist()}
        asked |= {"width": camera.width, "height": camera.height}
        text = self.evaluate(
            f"window.ibrpipe.render({json.dumps(asked)}, {json.dumps(options)}).then(({{rgba}}) => "
            "{ let text = ''; for (const value of rgba) text += String.fromCharCode(value); return btoa(text); })"
        )
        return np.frombuffer(base64.b64decode(text), np.uint8).reshape(camera.height, camera.width, 4)

    def screenshot(self, path: Path) -> None:
        """Save what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def drag(self, begin: tuple[float, float], end: tuple[float, float], button: str = "left") -> None:
        """Drag the mouse."""
        mouse = {"button": button, "buttons": {"left": 1, "right": 2}[button], "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=begin[0], y=begin[1], **mouse)
        for n in range(1, 6):
            x, y = (begin[k] + (end[k] - begin[k]) * n / 5 for k in range(2))
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **mouse)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], **mouse)

    def _call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]
            self._note(answer)

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._read, 1 << 20)
            if not part:
                raise AssertionError("Chromium ended by itself")
            self._rest += part
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        if event["method"] == "Runtime.exceptionThrown":
            self.errors.append(str(parameters["exceptionDetails"].get("exception", {}).get("description", parameters)))
        elif event["method"] == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])
        elif event["method"] == "Runtime.consoleAPICalled" and parameters["type"] == "error":
            self.errors.append(str(parameters["args"]))
        elif event["method"] == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
