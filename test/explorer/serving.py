"""The explorer's server, as a process or in this one, and files that change under it."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from starlette.applications import Starlette


@dataclass
class Server:
    process: subprocess.Popen[str]
    address: str
    said: str

    def get(self, path: str, data: bytes | None = None, **headers: str) -> tuple[int, bytes]:
        """Return status and content of an answer."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        request = urllib.request.Request(self.address + path, data, named)
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.read()


def started(*words: str) -> Server:
    """Start the program, and wait until it says where its page is."""
    command = [sys.executable, "-m", "pga_me_ros.explorer", *words, "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    address = process.stdout.readline().strip()
    assert address.startswith("http://"), process.communicate()
    said = process.stderr.readline().strip()
    return Server(process, address.replace("//0.0.0.0:", "//127.0.0.1:"), said)


@contextmanager
def running(app: Starlette) -> Iterator[int]:
    """Serve an application in this process; gives its port."""
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    yield listening.getsockname()[1]
    server.should_exit = True
    thread.join()


def replace(source: Path, target: Path) -> None:
    """Put a file in the place of another at once."""
    copy = target.with_suffix(".new")
    shutil.copy(source, copy)
    os.replace(copy, target)
