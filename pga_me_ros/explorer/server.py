"""The live page: serves it, simulates the gaits that it asks for, and tells it what has changed."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import traceback
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.explorer.motion import EpisodeStart
from pga_me_ros.explorer.page import build_page
from pga_me_ros.explorer.recorder import Recorder
from pga_me_ros.explorer.source import FORMATS, Source

LOOK_EVERY = 2.0
"""Seconds between two looks at the sources while a page is open, and between two of its news: each costs the run's
machine a question and an answer, and often the browser's drawing, too."""

HEED_EVERY = 0.25
"""Seconds after which whoever waits notices that the server is being stopped."""

QUIET = 10
"""Looks without news after which a page gets a sign of life, which also shows whether it is still there."""

PATIENCE = 30.0
"""Seconds after which a page that takes no news, as on a computer that sleeps, no longer counts as open."""

COOKIE = "explorer_token"
"""What the name of the cookie begins with; browsers send a host's cookies to all of its ports."""

MARK = b"x-explorer"
"""A header that only scripts of the page itself can send; forms and links of other pages cannot."""

STARTS = ("evaluation", "unseen:1")
"""Starts that the page offers at first."""


@dataclass(frozen=True)
class Access:
    """Who may do what.

    Attributes:
        token: What a browser must show; empty if anybody on this machine may look.
        control: Whether the page may pause, resume and stop the run, and change its rates.
        hosts: Names that requests may give the server; empty for any, where a token is required.
    """

    token: str
    control: bool
    hosts: tuple[str, ...]


def cookie_name(request: Request) -> str:
    """Return the name of the cookie that holds the token, with the port that the browser knows the server by."""
    port = request.headers.get("host", "").rpartition(":")[2]
    return f"{COOKIE}_{port}" if port.isdecimal() else COOKIE


class Guard:
    """Lets only those requests through that `Access` allows.

    Args:
        app: What it guards.
        access: Who may do what.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "http" and (refusal := self._refusal(scope)):
            await PlainTextResponse(refusal, 403)(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _refusal(self, scope: Scope) -> str:
        """Return why a request is refused, empty if it is not."""
        request = Request(scope)
        if self._access.hosts and request.url.hostname not in self._access.hosts:
            known = ", ".join(self._access.hosts)
            return f"The explorer does not answer to the name '{request.url.hostname}'; use one of {known}."
        if scope["method"] == "POST" and MARK not in dict(scope["headers"]):
            return "Only the explorer's own page may send this."
        if self._access.token:
            given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
            given = given or request.cookies.get(cookie_name(request), "")
            if not secrets.compare_digest(given.encode(), self._access.token.encode()):
                return "This page needs the token that the explorer printed when it started: open that address."
        return ""


class Server:
    """The application, and what it keeps between requests.

    Args:
        sources: What is shown.
        access: Who may do what.
        title: Title of the page.
        is_ending: Whether the server is being stopped.

    Attributes:
        watched: Number of pages that listen to news.
    """

    def __init__(
        self, sources: Sequence[Source], access: Access, title: str, is_ending: Callable[[], bool]
    ) -> None:
        self._sources, self._access, self._title = sources, access, title
        self._is_ending = is_ending
        self._recorders = [Recorder(source.settings, source.gait) for source in sources]
        # PyBullet, one episode at a time; looking at the sources must not wait for it, nor must who stops the run.
        self._simulating = ThreadPoolExecutor(1, "simulating")
        self._looking = ThreadPoolExecutor(1, "looking")
        self._steering = ThreadPoolExecutor(1, "steering")
        self.watched = 0
        self._last_taken = 0.0
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/api/run/{run:int}", self._run),
                Route("/api/motion/{run:int}/{cell:int}", self._motion),
                Route("/api/download/{run:int}/{cell:int}/{kind}", self._download),
                Route("/api/events", self._events),
                Route("/api/control/{run:int}", self._control, methods=["POST"]),
            ],
            middleware=[Middleware(Guard, access=access)],
            exception_handlers={PgaError: _told, OSError: _told},
            lifespan=self._lifespan,
        )

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        looking = asyncio.create_task(self._look())
        yield
        looking.cancel()
        for executor in (self._looking, self._steering, self._simulating):
            executor.shutdown(cancel_futures=True)
        for recorder in self._recorders:
            recorder.close()

    async def _look(self) -> None:
        """Look at the sources again and again while a page is open; nobody pays for a page that is closed."""
        loop = asyncio.get_running_loop()
        while True:
            if self.watched and loop.time() - self._last_taken < PATIENCE:
                for source in self._sources:
                    await loop.run_in_executor(self._looking, _refresh, source)
            await asyncio.sleep(LOOK_EVERY)

    def _content(self, run: int) -> dict[str, Any]:
        if not 0 <= run < len(self._sources):
            raise RequestError(f"There is no run {run}; this page shows {len(self._sources)}.")
        return {"version": self._sources[run].version, **self._sources[run].content}

    def _with_robot(self, run: int) -> dict[str, Any]:
        """Return what the page shows of a run, and what never changes: the robot, and its starts."""
        recorder = self._recorders[run]
        return {
            **self._content(run),
            "model": recorder.model,
            "model_missing": recorder.missing,
            "starts": list(STARTS),
            "simulates": True,
        }

    async def _page(self, request: Request) -> Response:
        runs = [self._with_robot(run) for run in range(len(self._sources))]
        content = {
            "title": self._title,
            "live": True,
            "control": self._access.control,
            "runs": runs,
        }
        response = HTMLResponse(build_page(content), headers={"Cache-Control": "no-store"})
        if self._access.token:
            name = cookie_name(request)
            response.set_cookie(name, self._access.token, httponly=True, samesite="strict")
        return response

    async def _run(self, request: Request) -> Response:
        return JSONResponse(self._content(request.path_params["run"]))

    async def _motion(self, request: Request) -> Response:
        run, cell = request.path_params["run"], request.path_params["cell"]
        start = EpisodeStart.of(request.query_params.get("start", "evaluation"))
        self._content(run)
        motion, evaluation = self._recorders[run].motion, _evaluation(request)
        return JSONResponse(await self._simulated(request, motion, cell, start, evaluation))

    async def _simulated(self, request: Request, work: Callable[..., Any], *values: Any) -> Any:
        """Return what a call gives that may take seconds; it is not begun if who asked has gone before its turn.

        Raises:
            RequestError: The server is stopped meanwhile; an answer is then still sent, not waited for in vain. Or who
                asked has gone, and nobody reads the answer.
        """
        work_done = asyncio.get_running_loop().run_in_executor(self._simulating, work, *values)
        while not work_done.done():
            if self._is_ending():
                raise RequestError("The explorer is being stopped.")
            if await request.is_disconnected():
                work_done.cancel()
                raise RequestError("Nobody waits for this any more.")
            await asyncio.wait([work_done], timeout=HEED_EVERY)
        return work_done.result()

    async def _download(self, request: Request) -> Response:
        run, cell, kind = (request.path_params[name] for name in ("run", "cell", "kind"))
        self._content(run)
        if kind not in FORMATS:
            raise RequestError(f"There is no format '{kind}'; give one of {', '.join(FORMATS)}.")
        source = self._sources[run]
        content = await self._simulated(request, source.download, cell, _evaluation(request), kind)
        name = f"{source.settings.task.replace(':', '-')}-cell{cell}{FORMATS[kind]}"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(content, media_type="application/octet-stream", headers=headers)

    async def _control(self, request: Request) -> Response:
        if not self._access.control:
            raise RequestError(
                "This page is read-only; start the explorer with --control to control the run."
            )
        run = request.path_params["run"]
        self._content(run)
        try:
            asked = json.loads(await request.body())
            action, values = str(asked["action"]), dict(asked.get("values", {}))
        except (ValueError, KeyError, TypeError) as error:
            raise RequestError(f"The request is malformed ({error}).") from None
        loop = asyncio.get_running_loop()
        said = await loop.run_in_executor(
            self._steering, self._sources[run].control, action, values
        )
        return JSONResponse({"said": said})

    async def _events(self, request: Request) -> Response:
        return StreamingResponse(
            self._news(), media_type="text/event-stream", headers={"Cache-Control": "no-store"}
        )

    async def _news(self) -> AsyncIterator[str]:
        """Yield the newest state whenever it has changed; a slow browser gets fewer of them, never a queue."""
        self.watched += 1
        told, quiet = "", 0
        try:
            while not self._is_ending():
                self._last_taken = asyncio.get_running_loop().time()
                news = json.dumps(
                    [
                        {"version": s.version, "problem": s.problem, "state": s.state()}
                        for s in self._sources
                    ]
                )
                quiet += 1
                if news != told:
                    told, quiet = news, 0
                    yield f"data: {news}\n\n"
                elif quiet % QUIET == 0:
                    yield ": still here\n\n"
                await self._next_look()
        finally:
            self.watched -= 1

    async def _next_look(self) -> None:
        """Wait until it is time for the next look, or the server is being stopped."""
        for _ in range(round(LOOK_EVERY / HEED_EVERY)):
            if self._is_ending():
                return
            await asyncio.sleep(HEED_EVERY)


def _evaluation(request: Request) -> int:
    """Return the evaluation of the gait that a page means; its cell may have another one by now.

    Raises:
        RequestError: There is none.
    """
    text = request.query_params.get("evaluation", "")
    if not re.fullmatch("[0-9]{1,19}", text):
        raise RequestError(f"evaluation is '{text}'; give the id of the gait's evaluation.")
    return int(text)


def _refresh(source: Source) -> None:
    """Look at a source; a fault in that is told by the page, too, which would otherwise seem to be up to date."""
    try:
        source.refresh()
    except Exception as error:
        traceback.print_exc()
        source.problem = f"The explorer has a fault ({error!r}); the page shows its last state."


async def _told(_: Request, error: Exception) -> Response:
    """Answer with what was wrong, in words for the page."""
    return JSONResponse({"error": str(error)}, 400)
