# SPDX-License-Identifier: Apache-2.0
"""
Test bench of a conformance case.

It has the clients of one interface, the decisions of the person at the rig (grant, abort), and the public state.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Protocol

from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import Permission

HEARTBEAT = 0  # sequence number of a heartbeat


class NotPossibleError(Exception):
    """Raised if the interface cannot express an action, so that the misuse under test is impossible."""


class CaseError(Exception):
    """Raised if a precondition of a case fails; the message names the precondition."""


@dataclasses.dataclass(frozen=True)
class View:
    """
    Public state that every client can read: lease in force (0: none), mode, set-points, pending request.

    sequence is the number of the set-point in force, speed in rad/s, turn in rad; pending is 0 if no request waits.
    """

    lease: int
    mode: int
    sequence: int
    speed: float
    turn: float
    pending: int = 0


@dataclasses.dataclass(frozen=True)
class ControlAnswer:
    """Answer to a request for control, with the fields of `control.status.ControlDecision`."""

    permission: int
    lease: int
    message: str = ""


@dataclasses.dataclass(frozen=True)
class Wish:
    """Request for control."""

    name: str = "conformance one"
    priority: int = 5
    wait: bool = False
    duration: float = 0.0  #: length of the lease, s
    #: `speed`, `left_speed`: limits, rad/s; 0 means the limit set at the rig.
    speed: float = 0.0
    left_speed: float = 0.0


@dataclasses.dataclass(frozen=True)
class Point:
    """Set-point of top drive or pumps, in SI units and rad."""

    mode: int = Mode.ROTATE
    speed: float = 0.5
    turn: float = 0.0
    flow: float = 0.0
    valid_for: float = 60.0


class AuthorityClient(Protocol):
    """
    Client of an interface, which the authority can distinguish from all other clients.

    Every method raises NotPossibleError if the interface cannot express the action.
    """

    def ask(self, wish: Wish) -> ControlAnswer:
        """Request control, or the renewal of a lease; return the answer of the authority."""

    def send(self, lease: int, sequence: int, point: Point) -> bool:
        """Send a set-point or a heartbeat; return whether the interface reports the message as accepted."""

    def release(self, lease: int) -> bool:
        """Give a lease back; return whether the authority released the lease."""


class Interface(Protocol):
    """Connection to the authority under test."""

    name: str
    largest: int  # largest set-point number that the interface can send
    lag_s: float  # time after which `view` shows the last action, s

    def peer(self, number: int) -> AuthorityClient:
        """Return a client; the same number gives the same client."""

    def view(self) -> View:
        """Return the public state of the authority."""

    def attacks(self) -> list[tuple[str, str, Callable[[Bench], tuple[bool, str]]]]:
        """Return the test cases that only this interface has: title, expected result, and function."""

    def close(self) -> None:
        """Close all clients."""


class Person(Protocol):
    """Person who decides at the rig."""

    def grant(self, number: int) -> bool:
        """Grant the request with this number; return whether the authority granted it."""

    def abort(self, name: str = "conformance") -> bool:
        """Take control back from every controller; return whether the authority did this. name : name of the person."""


class Bench:
    """
    Test bench of one interface and the person at the rig.

    Parameters
    ----------
    person : Person or None
        Person at the rig; None: nobody can grant or take back control, so cases that need a person are skipped.
    heartbeat_s : float
        Time after which the authority ends the lease of a silent controller.
    """

    def __init__(self, interface: Interface, person: Person | None, heartbeat_s: float) -> None:
        self.interface, self._person, self.heartbeat_s = interface, person, heartbeat_s
        self._held: list[tuple[AuthorityClient, int]] = []

    @property
    def person(self) -> Person:
        """Person who decides at the rig; raise NotPossibleError if there is none."""
        if self._person is None:
            raise NotPossibleError("nobody can decide at the rig; add --ros NAMESPACE")
        return self._person

    def one(self) -> AuthorityClient:
        """Return the client that gets control first."""
        return self.interface.peer(0)

    def other(self) -> AuthorityClient:
        """Return another client of the same interface."""
        return self.interface.peer(1)

    def view(self) -> View:
        """Return the public state of the authority."""
        time.sleep(self.interface.lag_s)
        return self.interface.view()

    def ask(self, peer: AuthorityClient, **wish: object) -> ControlAnswer:
        """
        Request control and return the answer; the person at the rig does not grant a pending request.

        The lease of the answer is given back at the next `reset`.
        """
        answer = peer.ask(Wish(**wish))  # type: ignore[arg-type]
        if answer.lease:
            self._held.append((peer, answer.lease))
        return answer

    def take(self, peer: AuthorityClient, **wish: object) -> int:
        """
        Request control, let the person grant a pending request, and return the number of the lease.

        Raises
        ------
        CaseError
            Control was not granted.
        NotPossibleError
            The request is pending, and there is no person who could grant it.
        """
        answer = self.ask(peer, **wish)
        if answer.permission == Permission.PENDING:
            self.person.grant(answer.lease)
            self.until(lambda: self.interface.view().lease == answer.lease)
            return answer.lease
        if answer.permission != Permission.GRANTED:
            raise CaseError(f"control was not granted: {answer.message or 'permission 0'}")
        return answer.lease

    def turning(self, sequence: int = 1, **point: object) -> int:
        """
        Let the first client take control and send a set-point, and return the number of its lease.

        Raises CaseError or NotPossibleError like `take` and `send`.
        """
        lease = self.take(self.one())
        self.send(lease, sequence, **point)
        return lease

    def send(self, lease: int, sequence: int = 1, **point: object) -> None:
        """
        Let the owner of the lease, the first client, send a set-point, and check that it comes into force.

        Raises CaseError if another set-point or none is in force after 3 s.
        """
        wanted = Point(**point)  # type: ignore[arg-type]
        self.one().send(lease, sequence, wanted)
        if not self.until(lambda: self._in_force(lease, sequence)):
            needs = "; turns need a toolface: is the MWD alive?" if wanted.turn else ""
            raise CaseError(f"set-point {sequence} of the owner did not come into force{needs}")

    def _in_force(self, lease: int, sequence: int) -> bool:
        view = self.interface.view()
        return (view.lease, view.sequence) == (lease, sequence)

    def until(self, true: Callable[[], bool], seconds: float = 3.0) -> bool:
        """Wait until a condition is true, at most `seconds`; return whether it became true."""
        end = time.monotonic() + seconds
        while not true():
            if time.monotonic() > end:
                return False
            time.sleep(0.05)
        return True

    def lives(self, lease: int, seconds: float) -> None:
        """Let the first client send heartbeats under a lease for `seconds`, s."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.one().send(lease, HEARTBEAT, Point())
            time.sleep(min(0.2, self.heartbeat_s / 5.0))

    def ends(self, lease: int) -> bool:
        """Return whether a lease ends within the heartbeat time plus a margin of 1.5 s."""
        return self.until(lambda: self.interface.view().lease != lease, self.heartbeat_s + 1.5)

    def reset(self) -> None:
        """
        Give the rig back to the driller, the initial state of every case.

        Raises CaseError if a lease stays in force.
        """
        for peer, lease in reversed(self._held):
            try:
                peer.release(lease)
            except NotPossibleError:
                continue
        self._held.clear()
        if self._person is not None:
            self._person.abort()
        if not self.until(lambda: self.interface.view().lease == 0, self.heartbeat_s + 3.0):
            raise CaseError("the rig was not given back after the previous case")
