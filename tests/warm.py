"""Commands of vdfmu in forks of one Python that has imported its modules: processes of their own that start at once.

Each gets its own arguments, folder, environment, streams and session, as a command that a user starts. What depends on
how Python itself starts (PYTHON* in the environment, the time to start) needs a real one.
"""

import atexit
import importlib
import json
import os
import pkgutil
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

_HEAD = struct.Struct("=q")


class Server:
    """The process that forks, seen from the tests."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        code = f"import sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r}); import tests.warm as w; w.serve()"
        with theirs:
            number = str(theirs.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-c", code, number], pass_fds=[theirs.fileno()], env=_environment(os.environ)
            )
        atexit.register(self._process.kill)

    def run(
        self,
        arguments: list[str],
        cwd: Path | str | None,
        env: Mapping[str, str] | None,
        stdin: bytes | None,
        timeout: float,
        merged: bool,
    ) -> tuple[int, bytes, bytes]:
        """Run a command; return its exit code and what it wrote. After `timeout` seconds it is killed: raises."""
        asked = {
            "arguments": arguments, "folder": str(cwd or Path.cwd()), "environment": _environment(env or os.environ),
        }  # fmt: skip
        content = json.dumps(asked).encode()
        with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as failed, tempfile.TemporaryFile() as source:
            source.write(stdin or b"")
            source.seek(0)
            files = [source.fileno(), said.fileno(), (said if merged else failed).fileno()]
            socket.send_fds(self._socket, [_HEAD.pack(len(content))], files)
            self._socket.sendall(content)
            child = self._answer(60.0)
            try:
                code = self._answer(timeout)
            except TimeoutError:
                os.killpg(child, signal.SIGKILL)
                self._answer(60.0)
                raise subprocess.TimeoutExpired(arguments, timeout) from None
            said.seek(0)
            failed.seek(0)
            return code, said.read(), failed.read()

    def _answer(self, timeout: float) -> int:
        if not select.select([self._socket], [], [], timeout)[0]:
            raise TimeoutError
        return _HEAD.unpack(_received(self._socket, _HEAD.size))[0]


@cache
def _server() -> Server:
    return Server()


def command(
    *arguments: Any,
    cwd: Path | str | None = None,
    env: Mapping[str, str] | None = None,
    input: str | None = None,  # noqa: A002 - as subprocess.run
    timeout: float = 300.0,
    errors: str = "surrogateescape",
    merged: bool = False,
) -> subprocess.CompletedProcess[str]:
    """Run ``vdfmu arguments``, as :func:`subprocess.run` with text; `merged`: errors go to the standard output."""
    words = [str(each) for each in arguments]
    if not hasattr(socket, "send_fds"):  # on Windows
        return subprocess.run(
            [sys.executable, "-m", "vdfmu.cli", *words], cwd=cwd, env=env, input=input, timeout=timeout, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT if merged else subprocess.PIPE, encoding="utf-8",
            errors=errors,
        )  # fmt: skip
    stdin = None if input is None else input.encode()
    code, *said = _server().run(words, cwd, env, stdin, timeout, merged)
    out, error = (text.decode(errors=errors).replace("\r\n", "\n") for text in said)
    return subprocess.CompletedProcess(["vdfmu", *words], code, out, error)


def _environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return it without what tells a program that it is part of a test."""
    return {k: v for k, v in environment.items() if not k.startswith(("PYTEST_", "COV_"))}


def _received(stream: socket.socket, size: int) -> bytes:
    content = b""
    while len(content) < size:
        part = stream.recv(size - len(content))
        if not part:
            sys.exit(0)
        content += part
    return content


def serve() -> None:
    """Fork for each command; a fork returns into its command."""
    for module in pkgutil.walk_packages(importlib.import_module("vdfmu").__path__, "vdfmu."):
        if not module.name.endswith("__main__") and ".fmu.python" not in module.name:
            importlib.import_module(module.name)
    stream = socket.socket(fileno=int(sys.argv[1]))
    while True:
        head, files, _, _ = socket.recv_fds(stream, _HEAD.size, 3)
        if not head:
            sys.exit(0)
        asked = json.loads(_received(stream, _HEAD.unpack(head)[0]))
        number = os.fork()
        if number == 0:
            break
        for file in files:
            os.close(file)
        stream.sendall(_HEAD.pack(number))
        _, status = os.waitpid(number, 0)
        stream.sendall(_HEAD.pack(os.waitstatus_to_exitcode(status)))
    os.setsid()
    stream.close()
    for descriptor, file in enumerate(files):
        os.dup2(file, descriptor)
        os.close(file)
    os.chdir(asked["folder"])
    os.environ.clear()
    os.environ.update(asked["environment"])
    sys.argv = ["vdfmu", *asked["arguments"]]
    from vdfmu.cli import main

    main()
