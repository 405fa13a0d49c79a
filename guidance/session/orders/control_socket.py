"""Orders on this computer: a Unix-domain socket beside the daemon's token, one JSON line each way.

`socket_client` is the client's side. Other users cannot reach the socket: it has the token file's rights, and each
order shows the token.
"""

import contextlib
import hmac
import json
import os
import socket
import stat
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final, Protocol

from guidance.errors import GuidanceError, OutputError
from guidance.session.orders.control_token import ControlToken, reachable, socket_path
from guidance.session.orders.replies import Reply, written
from guidance.session.orders.words import WORDS, name_in

_ASKED_WITHIN_S: Final = 1.0

_LONGEST_ORDER: Final = 4096

_BUFFER_BYTES: Final = 65536
"""Read at once: bytes left unread would reset the connection before the answer arrives."""

MOST_AT_ONCE: Final = 64

_ACCEPT_AGAIN_S: Final = 0.05


def begin_exchange(
    free: threading.BoundedSemaphore, exchange: Callable[..., None], *arguments: object
) -> bool:
    """Start an exchange with a client on a thread of its own; False if `free` says that too many are under way.

    No exchange waits for another one: an abort does not wait until an engage order is answered.
    """
    if not free.acquire(blocking=False):
        return False

    def run() -> None:
        try:
            exchange(*arguments)
        finally:
            free.release()

    try:
        threading.Thread(target=run, name="order", daemon=True).start()
    except RuntimeError:  # no thread is free at the moment
        free.release()
        return False
    return True


class PassOn(Protocol):
    """Gives an order to a team and returns an answer for each vehicle."""

    def __call__(
        self, order: str, team: str, names: Collection[str], *, by: str
    ) -> Sequence[Reply]:
        """Raise LinkError if no vehicle of the team answers."""


class ControlSocket:
    """Takes orders at a socket, and answers. Every connection has a thread for one order.

    Args:
        name: The daemon's.
        answer: Answers an order or a query, given with the name of its sender.
        token: The secret that clients must know; the socket gets the rights of its file.
        pass_on: Gives an order to a team; None takes no such orders.

    Raises:
        OutputError: If the socket cannot be made.
    """

    def __init__(
        self,
        name: str,
        answer: Callable[[str, str], Reply],
        token: ControlToken,
        pass_on: PassOn | None = None,
    ) -> None:
        self._name = name
        self._answer = answer
        self._token = token
        self._pass_on = pass_on
        self._path = socket_path(token.path)
        self._free = threading.BoundedSemaphore(MOST_AT_ONCE)
        self._closed = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            # A killed daemon may have left it: the endpoint is ours by now
            self._path.unlink(missing_ok=True)
            with reachable(self._path) as address:
                self._listener.bind(address)
            rights = token.path.stat()
            with contextlib.suppress(PermissionError):
                os.chown(self._path, -1, rights.st_gid)
            readable = stat.S_IMODE(rights.st_mode) & 0o444
            # Readers of the token may write to the socket
            self._path.chmod(readable | readable >> 1)
            self._listener.listen(MOST_AT_ONCE)
        except OSError as error:
            self._listener.close()
            raise OutputError(
                f"control socket {self._path}: cannot be made ({error.strerror})"
            ) from error
        self._thread = threading.Thread(target=self._serve, name="control socket")
        self._thread.start()

    def close(self) -> None:
        """Take no more orders. May be called twice."""
        self._closed.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # ends the accept that waits
        self._thread.join()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _serve(self) -> None:
        while not self._closed.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:  # it was shut down, or no descriptor is free at the moment
                self._closed.wait(_ACCEPT_AGAIN_S)
                continue
            if not begin_exchange(self._free, self._exchange, connection):
                connection.close()

    def _exchange(self, connection: socket.socket) -> None:
        # The data may be anything
        with (
            connection,
            contextlib.suppress(OSError, ValueError, TypeError, AttributeError, RecursionError),
        ):
            connection.settimeout(_ASKED_WITHIN_S)
            request = json.loads(connection.makefile("rb", _BUFFER_BYTES).readline(_LONGEST_ORDER))
            answer: Mapping[str, Any]
            if not hmac.compare_digest(
                str(request.get("token")).encode(), self._token.secret.encode()
            ):
                answer = {"error": "the token is not this daemon's"}
            else:
                by = name_in(str(request.get("by", "")).encode())
                if self._pass_on is not None and "team_order" in request:
                    answer = self._answer_of_team(request, self._pass_on, by)
                elif request.get("name") not in {None, self._name}:
                    answer = {
                        "error": f"--name {request['name']}: the daemon there is {self._name}"
                    }
                else:
                    answered = self._answer(str(request.get("order")), by)
                    answer = {"name": self._name, **answered} | {"name": self._name}
            connection.sendall(written(answer) + b"\n")

    def _answer_of_team(
        self, request: Mapping[str, Any], pass_on: PassOn, by: str
    ) -> Mapping[str, Any]:
        order = str(request["team_order"])
        names = [str(name) for name in request.get("names", ())]
        if order not in WORDS:
            return {"error": f"order = {order!r}: allowed are {', '.join(WORDS)}"}
        try:
            answers = pass_on(order, str(request.get("team", "")), names, by=by)
        except GuidanceError as error:
            return {"error": str(error)}
        return {"answers": {answer["name"]: answer for answer in answers}}
