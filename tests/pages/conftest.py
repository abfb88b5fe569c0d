"""The site as it is built, served from here, and a browser that looks at it. The browser is spoken to over a pipe in
the DevTools protocol, which needs nothing but the browser itself."""

import functools
import http.server
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[2]
FLAGS = "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --disable-sync "
FLAGS += "--disable-component-update --disable-extensions --remote-debugging-pipe --window-size=1300,1000"
PATIENCE = 300  # seconds, for a browser that shares its machine with other tests
# Chromium reads from descriptor 3 and writes to 4.
LAUNCH = """import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
os.dup2(ends[0], 3), os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
# What a reader would see as broken: a picture without pixels, a formula left as it was typed or set in red.
LOOK = """(async () => {
    const left = () => [...document.querySelectorAll(".arithmatex")].filter(each => !each.querySelector(".katex"));
    for (let tenths = 0; tenths < 50 && left().length; tenths++) await new Promise(done => setTimeout(done, 100));
    const pictures = [...document.querySelectorAll("img")];
    pictures.forEach(picture => { picture.loading = "eager"; });
    const shown = pictures.map(picture => picture.decode().then(() => null, () => picture.src));
    const wrong = [...document.querySelectorAll(".katex-error")];
    return JSON.stringify({
        pictures: (await Promise.all(shown)).filter(each => each !== null),
        formulas: [...left(), ...wrong].map(each => each.textContent),
    });
})()"""


class Browser:
    """Headless Chromium with one page open."""

    def __init__(self, program: str, folder: Path):
        self._numbers = itertools.count(1)
        self._seen: list[dict] = []
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        command = [sys.executable, "-c", LAUNCH, str(theirs_in), str(theirs_out), program, *FLAGS.split()]
        command += [f"--user-data-dir={folder}", "about:blank"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, pass_fds=(theirs_in, theirs_out), **quiet)
        os.close(theirs_in)
        os.close(theirs_out)
        self._buffer = b""
        self._session = None
        target = next(t for t in self._call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self._call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")
        self._call("Network.setCacheDisabled", cacheDisabled=True)  # what a page weighs, it weighs on a first visit

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(20)
        os.close(self._out)
        os.close(self._in)

    def visit(self, address: str) -> "Visit":
        """Opens a page, waits until all of it is there, and says what happened."""
        self._seen = []
        self._call("Page.navigate", url=address)
        while not any(event["method"] == "Page.loadEventFired" for event in self._seen):
            self._seen.append(self._receive())
        found = self._call("Runtime.evaluate", expression=LOOK, awaitPromise=True, returnByValue=True)
        return Visit(address, json.loads(found["result"]["value"]), self._seen)

    def _call(self, method: str, **parameters) -> dict:
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
            self._seen.append(answer)

    def _receive(self) -> dict:
        while b"\0" not in self._buffer:
            assert select.select([self._in], [], [], PATIENCE)[0], "the browser does not answer"
            part = os.read(self._in, 1 << 16)
            assert part, "the browser is gone"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)


class Visit:
    """What a browser met on a page."""

    def __init__(self, address: str, look: dict, events: list[dict]):
        self.pictures: list[str] = look["pictures"]
        self.formulas: list[str] = look["formulas"]
        self.errors: list[str] = []
        self.asked: list[str] = []
        self.bytes = 0
        for event in events:
            method, what = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(what["exceptionDetails"]))
            elif method == "Runtime.consoleAPICalled" and what["type"] in ("error", "assert"):
                self.errors.append(json.dumps(what["args"]))
            elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
                self.errors.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")
            elif method == "Network.responseReceived" and what["response"]["status"] >= 400:
                self.errors.append(f"{what['response']['status']} {what['response']['url']}")
            elif method == "Network.loadingFailed" and not what.get("canceled"):
                self.errors.append(what["errorText"])
            elif method == "Network.requestWillBeSent" and not what["request"]["url"].startswith("data:"):
                self.asked.append(what["request"]["url"])
            elif method == "Network.loadingFinished":
                self.bytes += int(what["encodedDataLength"])


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format, *args):
        pass


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The folder of the site, built as CI builds it."""
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="session")
def address(site):
    """Where the site is served."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=site))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """A browser; without one, whoever asks for it is skipped."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no browser: apt-get install chromium")
    browser = Browser(program, tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
