"""A headless Chromium, driven by its DevTools protocol over a pipe: true key presses, and no library needed."""

import json
import os
import shlex
import shutil
import subprocess
from pathlib import Path

#: The names under which it is installed; the first that is found is used.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
CHROMIUM = next((path for path in map(shutil.which, NAMES) if path), None)


class Page:
    """One page, as a context; `events` are what the browser has told unasked, such as requests and exceptions."""

    def __init__(self, file: Path, scratch: Path) -> None:
        self.file, self.scratch, self.events, self._asked = file, scratch, [], 0

    def __enter__(self) -> "Page":
        reads, theirs_out = os.pipe()
        theirs_in, writes = os.pipe()
        flags = "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --remote-debugging-pipe"
        start = f"exec {shlex.quote(str(CHROMIUM))} {flags} --user-data-dir={shlex.quote(str(self.scratch))}"
        self._process = subprocess.Popen(
            ["bash", "-c", f"{start} 3<&{theirs_in} 4>&{theirs_out}"],
            pass_fds=(theirs_in, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._out, self._in = os.fdopen(reads, "rb"), os.fdopen(writes, "wb", buffering=0)
        self._session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.size(1100, 900)
        self.call("Page.navigate", url=self.file.as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self._read())
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(30)
        self._in.close()
        self._out.close()

    def _read(self) -> dict:
        """The next message, which ends in a zero byte."""
        text = bytearray()
        while (byte := self._out.read(1)) != b"\0":
            if not byte:
                raise RuntimeError("the browser has ended")
            text += byte
        return json.loads(text)

    def call(self, method: str, **parameters) -> dict:
        """What the browser answers to a command."""
        self._asked += 1
        command = {"id": self._asked, "method": method, "params": parameters}
        if self._session is not None:
            command["sessionId"] = self._session
        self._in.write(json.dumps(command).encode() + b"\0")
        while (message := self._read()).get("id") != self._asked:
            self.events.append(message)
        assert "error" not in message, message
        return message["result"]

    def evaluate(self, expression: str):
        """The value of an expression, or of what it promises."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Presses a key, by its name and its virtual code."""
        text = {"text": " "} if key == " " else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)

    def size(self, width: int, height: int) -> None:
        """Makes the window as large as a screen [pixels]."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def told(self, method: str) -> list[dict]:
        """The parameters of the events of a kind so far."""
        return [event["params"] for event in self.events if event["method"] == method]
