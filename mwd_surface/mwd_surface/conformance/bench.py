# SPDX-License-Identifier: Apache-2.0
"""Tools of a conformance case: clients of one interface, the person at the rig, and the public state."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Protocol

from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import Permission

HEARTBEAT = 0  # the number of a heartbeat


class NotPossibleError(Exception):
    """The interface has no way to express this, so that nobody can misuse it in this way."""


class CaseError(Exception):
    """Failed precondition of a case; the message names it."""


@dataclasses.dataclass(frozen=True)
class View:
    """Public state, which every client can read: lease in force (0: none), mode, set-points, pending request."""

    lease: int
    mode: int
    sequence: int
    speed: float
    turn: float
    pending: int = 0


@dataclasses.dataclass(frozen=True)
class Answer:
    """Answer to a request for control, as `control.status.Decision`."""

    permission: int
    lease: int
    message: str = ""


@dataclasses.dataclass(frozen=True)
class Wish:
    """A request for control; units as in mwd_msgs/RequestControl. 0: as set at the rig."""

    name: str = "conformance one"
    priority: int = 5
    wait: bool = False
    duration: float = 0.0
    speed: float = 0.0
    left_speed: float = 0.0


@dataclasses.dataclass(frozen=True)
class Point:
    """A set-point, SI and rad."""

    mode: int = Mode.ROTATE
    speed: float = 0.5
    turn: float = 0.0
    flow: float = 0.0
    valid_for: float = 60.0


class Peer(Protocol):
    """One client of an interface, that the authority can tell from every other one."""

    def ask(self, wish: Wish) -> Answer:
        """Ask for control, or for its renewal."""

    def send(self, lease: int, sequence: int, point: Point) -> bool:
        """Send a set-point or a heartbeat; return whether the interface reports it as accepted."""

    def release(self, lease: int) -> bool:
        """Give a lease back; returns whether that was done."""


class Interface(Protocol):
    """A connection to the authority under test."""

    name: str
    largest: int  # number of a set-point that the interface can send
    lag_s: float  # time after which `view` shows what was just done

    def peer(self, number: int) -> Peer:
        """Return one of the clients, the same for the same number."""

    def view(self) -> View:
        """Read the public state."""

    def attacks(self) -> list[tuple[str, str, Callable[[Bench], tuple[bool, str]]]]:
        """Return cases of this interface alone: title, what is expected, and the case."""

    def close(self) -> None:
        """End all its clients."""


class Person(Protocol):
    """The person who decides at the rig."""

    def grant(self, number: int) -> bool:
        """Grant a request; returns whether it was done."""

    def abort(self, name: str = "conformance") -> bool:
        """Take control back; returns whether it was done."""


class Bench:
    """
    One interface and the person at the rig.

    Parameters
    ----------
    interface : Interface
    person : Person or None
        None: nobody can grant or take back, so that cases that need a person are left out.
    heartbeat_s : float
        Time after which the authority counts a silent controller as dead.
    """

    def __init__(self, interface: Interface, person: Person | None, heartbeat_s: float) -> None:
        self.interface, self._person, self.heartbeat_s = interface, person, heartbeat_s
        self._held: list[tuple[Peer, int]] = []

    @property
    def person(self) -> Person:
        """The person who decides at the rig."""
        if self._person is None:
            raise NotPossibleError("nobody can decide at the rig; add --ros NAMESPACE")
        return self._person

    def one(self) -> Peer:
        """Return the client that behaves at first."""
        return self.interface.peer(0)

    def other(self) -> Peer:
        """Return another client of the same interface."""
        return self.interface.peer(1)

    def view(self) -> View:
        """Read the public state after it shows the last action."""
        time.sleep(self.interface.lag_s)
        return self.interface.view()

    def ask(self, peer: Peer, **wish: object) -> Answer:
        """Ask, without a grant by a person."""
        answer = peer.ask(Wish(**wish))  # type: ignore[arg-type]
        if answer.lease:
            self._held.append((peer, answer.lease))
        return answer

    def take(self, peer: Peer, **wish: object) -> int:
        """Ask for control, have the request granted, and return the lease."""
        answer = self.ask(peer, **wish)
        if answer.permission == Permission.PENDING:
            self.person.grant(answer.lease)
            self.until(lambda: self.interface.view().lease == answer.lease)
            return answer.lease
        if answer.permission != Permission.GRANTED:
            raise CaseError(f"control was not granted: {answer.message or 'permission 0'}")
        return answer.lease

    def turning(self, peer: Peer, lease: int, sequence: int = 1, **point: object) -> None:
        """Let the owner send a set-point, and check that it is in force."""
        wanted = Point(**point)  # type: ignore[arg-type]
        peer.send(lease, sequence, wanted)
        if not self.until(lambda: self._in_force(lease, sequence)):
            raise CaseError(f"set-point {sequence} of the owner was refused")

    def _in_force(self, lease: int, sequence: int) -> bool:
        view = self.interface.view()
        return (view.lease, view.sequence) == (lease, sequence)

    def until(self, true: Callable[[], bool], seconds: float = 3.0) -> bool:
        """Wait until something is true; returns whether it became so."""
        end = time.monotonic() + seconds
        while not true():
            if time.monotonic() > end:
                return False
            time.sleep(0.05)
        return True

    def lives(self, peer: Peer, lease: int, seconds: float) -> None:
        """Let a controller send heartbeats for some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            peer.send(lease, HEARTBEAT, Point())
            time.sleep(min(0.2, self.heartbeat_s / 5.0))

    def ends(self, lease: int, within: float | None = None) -> bool:
        """Whether a lease ends within a time, by default that of a dead controller and a second."""
        return self.until(
            lambda: self.interface.view().lease != lease, self.heartbeat_s + 1.5 if within is None else within
        )

    def reset(self) -> None:
        """Give the rig back to the driller, as every case finds it."""
        for peer, lease in reversed(self._held):
            try:
                peer.release(lease)
            except NotPossibleError:
                continue
        self._held.clear()
        if self._person is not None:
            self._person.abort()
        if not self.until(lambda: self.interface.view().lease == 0, self.heartbeat_s + 3.0):
            raise CaseError("the rig was not given back after the case before")
