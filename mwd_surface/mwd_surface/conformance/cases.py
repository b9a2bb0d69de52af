# SPDX-License-Identifier: Apache-2.0
"""
Cases for every interface of a control authority; each uses or misuses the interface and reads the public state.

A case is a function that takes a `Bench` and returns whether the authority behaved correctly, and what was observed.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
import time
from collections.abc import Callable, Iterator

from mwd_surface.conformance.bench import HEARTBEAT, Bench, CaseError, Interface, NotPossibleError, Person, Point
from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import Permission

Case = Callable[[Bench], tuple[bool, str]]
CASES: list[tuple[str, str, Case]] = []  # title, expected result and function of each case
_OBEYS = (Mode.ROTATE, Mode.ORIENT, Mode.PUMP)  # modes in which a set-point moves top drive or pumps
_FAR = 1e6  # value that exceeds every limit, in any unit


@dataclasses.dataclass(frozen=True)
class Result:
    """Result of one case."""

    case: str
    interface: str
    expected: str
    observed: str
    passed: bool | None  #: None if the interface cannot express the misuse, or no person could decide


def case(title: str, expected: str) -> Callable[[Case], Case]:
    """Return a decorator that adds a function to `CASES`."""

    def add(function: Case) -> Case:
        CASES.append((title, expected, function))
        return function

    return add


def run(interface: Interface, person: Person | None, heartbeat_s: float) -> Iterator[Result]:
    """
    Run every case on an interface, one after the other, and yield the results.

    Raises CaseError if the rig cannot be given back after the last case.
    """
    bench = Bench(interface, person, heartbeat_s)
    for title, expected, function in (*CASES, *interface.attacks()):
        passed: bool | None
        try:
            bench.reset()
            passed, observed = function(bench)
        except NotPossibleError as error:
            passed, observed = None, str(error)
        except CaseError as error:
            passed, observed = False, str(error)
        yield Result(title, interface.name, expected, observed, passed)
    bench.reset()


def _refused(bench: Bench, lease: int, taken: bool, sequence: int = 1) -> tuple[bool, str]:
    """
    Return whether a forbidden command was refused without effect on the owner of the lease, and a text that says so.

    lease, sequence: numbers of the owner's lease and set-point, which must stay in force; taken: whether the interface
    reported the command as accepted.
    """
    view = bench.view()
    if not taken and view.lease != lease:
        # The command was refused, but the lease ended: a heartbeat of this program was late, or the MWD fell silent.
        return (
            False,
            f"refused, but the owner lost its lease {lease} meanwhile (now {view.lease}); see the reason of its end",
        )
    if taken or view.sequence != sequence:
        return False, f"accepted: lease {view.lease}, set-point {view.sequence} in force"
    return True, f"refused; set-point {sequence} stays in force"


# Correct use, renewals of a lease, and its end.


@case("a controller obeys all rules", "control is granted, commands are obeyed, control is given back")
def _honest(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning()
    bench.lives(lease, bench.heartbeat_s + 0.5)
    kept = bench.view().lease == lease
    given = bench.one().release(lease) and bench.ends(lease)
    return kept and given, (
        f"the lease {'lasted' if kept else 'ended'} during heartbeats and was {'' if given else 'not '}given back"
    )


def _renewed(bench: Bench, granted: dict[str, float], more: dict[str, float]) -> tuple[bool, str]:
    lease = bench.take(bench.one(), **granted)
    bench.send(lease)
    answer = bench.ask(bench.one(), **{**granted, **more})
    if answer.permission == Permission.GRANTED:
        return False, f"granted: lease {answer.lease}"
    same, observed = _refused(bench, lease, taken=False)
    return same, f"{'denied' if answer.permission == Permission.DENIED else 'waits for a person'}; {observed}"


def _renewal(title: str, granted: dict[str, float], more: dict[str, float]) -> None:
    @case(f"a lease is renewed {title}", "denied, or a person decides")
    def renewal(bench: Bench) -> tuple[bool, str]:
        return _renewed(bench, granted, more)


_renewal("with a higher priority", {"priority": 1}, {"priority": 255})
_renewal("for a longer time", {"duration": 20.0}, {"duration": 30.0})
_renewal("for the longest time, requested as 0", {"duration": 20.0}, {"duration": 0.0})


@case("a lease is renewed with a wider limit", "denied, or a person decides; the old limit stays in force")
def _renewal_wider(bench: Bench) -> tuple[bool, str]:
    passed, observed = _renewed(bench, {"speed": 1.0}, {"speed": 2.0})
    lease = bench.view().lease
    return (passed and not bench.one().send(lease, 2, Point(speed=1.5))), observed


_renewal("with the limits of the rig, requested as 0", {"speed": 1.0}, {"speed": 0.0})


@case("a lease is renewed with the same conditions", "the same lease is prolonged")
def _renewal_same(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one(), duration=3.0)
    bench.lives(lease, 1.5)
    answer = bench.ask(bench.one(), duration=3.0)
    bench.lives(lease, 2.0)
    view = bench.view()
    passed = (answer.permission, answer.lease, view.lease) == (Permission.GRANTED, lease, lease)
    return passed, f"permission {answer.permission}, lease {answer.lease}; in force 2 s later: {view.lease}"


@case("a lease is renewed after it has expired", "a new lease with a higher number, or none")
def _renewal_late(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one(), duration=1.0)
    bench.lives(lease, 1.5)
    answer = bench.ask(bench.one(), duration=1.0)
    return answer.lease == 0 or answer.lease > lease, f"lease {lease} ended; the answer has lease {answer.lease}"


@case("a set-point under a lease that has expired", "refused")
def _late(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one(), duration=1.0)
    bench.send(lease)
    bench.lives(lease, 1.3)
    taken = bench.one().send(lease, 2, Point())
    view = bench.view()
    return not taken and view.lease == 0 and view.mode not in _OBEYS, f"lease {view.lease}, mode {view.mode}"


@case("the client in control requests control under a second name", "denied")
def _second_name(bench: Bench) -> tuple[bool, str]:
    bench.take(bench.one())
    answer = bench.ask(bench.one(), name="conformance two", priority=200)
    return answer.permission == Permission.DENIED, f"permission {answer.permission}"


# Sequence numbers of set-points.


def _misuse(
    title: str, misuse: Callable[[Bench, int], bool], expected: str = "refused", sequence: int = 1, **point: object
) -> None:
    """Add a case: the owner of a lease sends a set-point; then `misuse` is called with the lease, and must fail."""

    @case(title, expected)
    def misused(bench: Bench) -> tuple[bool, str]:
        lease = bench.turning(sequence, **point)
        return _refused(bench, lease, misuse(bench, lease), sequence)


def _sent(sequence: int, point: Point) -> Callable[[Bench, int], bool]:
    """Return a misuse: the owner sends a set-point."""
    return lambda bench, lease: bench.one().send(lease, sequence, point)


_TURN = Point(Mode.ORIENT, 0.0, 0.2)
_misuse(
    "a turn is sent twice with the same number",
    _sent(1, _TURN),
    "the second is refused; the string turns once",
    mode=Mode.ORIENT,
    turn=0.2,
    speed=0.0,
)
_misuse("a rotation is sent twice with the same number", _sent(1, Point()))
_misuse("a different set-point with the number of the last one", _sent(1, _TURN))
_misuse("a set-point with a lower number than the last one", _sent(3, Point(speed=0.2)), sequence=5)


@case("after the largest number, a set-point with number 1", "refused; control can be given back")
def _overflow(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning(bench.interface.largest)
    passed, observed = _refused(bench, lease, bench.one().send(lease, 1, Point()), bench.interface.largest)
    return passed and bench.one().release(lease), observed


@case("the first set-point under a new lease has number 1", "accepted")
def _new_numbers(bench: Bench) -> tuple[bool, str]:
    first = bench.turning(7)
    bench.one().release(first)
    second = bench.turning()
    return second > first, f"lease {first}, then lease {second}"


# Missing and repeated heartbeats.


@case("the controller falls silent", "the lease ends with the configured reaction")
def _silence(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning(mode=Mode.ORIENT, turn=0.2, speed=0.0)
    ended = bench.ends(lease)
    return ended, f"the lease {'ended' if ended else 'was kept alive'}; mode {bench.view().mode}"


def _no_heartbeat(title: str, send: Callable[[Bench, int], object]) -> None:
    @case(title, "they do not count as heartbeats: the lease ends")
    def no_heartbeat(bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        end = time.monotonic() + bench.heartbeat_s + 1.5
        while time.monotonic() < end and bench.interface.view().lease == lease:
            send(bench, lease)
            time.sleep(0.1)
        ended = bench.view().lease != lease
        return ended, f"the lease {'ended' if ended else 'was kept alive'}"


_no_heartbeat("the controller sends only refused set-points (not a number)", _sent(2, Point(speed=math.nan)))
_no_heartbeat("the controller sends only refused set-points (beyond a limit)", _sent(2, Point(speed=_FAR)))
_no_heartbeat("the controller sends only refused set-points (an old number)", _sent(1, Point()))
_no_heartbeat(
    "the controller sends only renewals that are refused", lambda bench, _lease: bench.ask(bench.one(), priority=250)
)
_no_heartbeat(
    "another client sends heartbeats for the lease", lambda bench, lease: bench.other().send(lease, HEARTBEAT, Point())
)


@case("a set-point that is valid for 0.4 s, and no later one", "the string is held; the lease stays")
def _validity(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one())
    bench.one().send(lease, 1, Point(valid_for=0.4))
    held = bench.until(lambda: bench.interface.view().mode == Mode.HOLD, bench.heartbeat_s)
    return held, f"mode {bench.view().mode}"


@case("a set-point that is valid for 1e30 s, then silence", "the lease ends nevertheless")
def _valid_for_ever(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning(valid_for=1e30)
    return bench.ends(lease), f"lease {bench.view().lease}"


# Two controllers.


@case("a second controller with the same priority requests control", "denied")
def _tie(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one())
    answer = bench.ask(bench.other(), name="conformance two")
    view = bench.view()
    passed = answer.permission == Permission.DENIED and view.lease == lease
    return passed, f"permission {answer.permission}, lease {view.lease}"


@case("a second controller with a lower priority requests control", "denied")
def _lower(bench: Bench) -> tuple[bool, str]:
    bench.take(bench.one())
    answer = bench.ask(bench.other(), name="conformance two", priority=4)
    return answer.permission == Permission.DENIED, f"permission {answer.permission}"


@case(
    "a second controller with a higher priority requests control",
    "the second takes over, or a person decides; then set-points of the first are refused",
)
def _higher(bench: Bench) -> tuple[bool, str]:
    first = bench.take(bench.one())
    second = bench.take(bench.other(), name="conformance two", priority=9)
    taken = bench.one().send(first, 1, Point())
    view = bench.view()
    return second > first and not taken and view.lease == second, f"lease {view.lease}, set-point {view.sequence}"


_misuse(
    "another client sends a set-point with the lease number of the controller in control",
    lambda bench, _lease: bench.other().send(bench.view().lease, 2, Point(speed=0.9)),
)
_misuse(
    "another client gives back the lease of the controller in control",
    lambda bench, _lease: bench.other().release(bench.view().lease),
)


@case("another client requests control under the name of the controller in control", "denied")
def _impostor(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning()
    answers = [bench.ask(bench.other(), priority=priority).permission for priority in (5, 255)]
    passed, observed = _refused(bench, lease, taken=False)
    return passed and set(answers) == {Permission.DENIED}, f"permissions {answers}; {observed}"


@case("another client requests control under the name of a waiting request", "denied")
def _impostor_waits(bench: Bench) -> tuple[bool, str]:
    bench.take(bench.one())
    waits = bench.ask(bench.other(), name="conformance two", wait=True)
    if waits.permission != Permission.PENDING:
        raise CaseError(f"a request that waits has permission {waits.permission}")
    answer = bench.ask(bench.interface.peer(2), name="conformance two", wait=True)
    return answer.permission == Permission.DENIED, f"permission {answer.permission}"


@case("eight clients request control at once", "at most one has control")
def _at_once(bench: Bench) -> tuple[bool, str]:
    peers = [bench.interface.peer(number) for number in range(8)]
    with concurrent.futures.ThreadPoolExecutor(len(peers)) as pool:
        asked = [pool.submit(bench.ask, peer, name=f"conformance {k}") for k, peer in enumerate(peers)]
        answers = [one.result() for one in asked]
    granted = sum(answer.permission == Permission.GRANTED for answer in answers)
    waiting = {answer.lease for answer in answers if answer.permission == Permission.PENDING}
    return granted + len(waiting) == 1, f"{granted} requests granted, {len(waiting)} waiting"


@case("two clients send set-points under one lease at the same time", "only the owner of the lease is obeyed")
def _both(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one())
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        theft = pool.submit(lambda: [bench.other().send(lease, k, Point(speed=0.9)) for k in range(2, 9, 2)])
        for sequence in (1, 3, 5):
            bench.send(lease, sequence)
        stolen = sum(theft.result())
    view = bench.view()
    return (
        stolen == 0 and view.sequence == 5,
        f"{stolen} of 4 set-points of the other client accepted, set-point {view.sequence} in force",
    )


# Set-points beyond the limits.


for _title, _point in (
    ("a speed beyond its limit", Point(speed=_FAR)),
    ("left-hand rotation", Point(speed=-0.5)),
    ("a very slow left-hand rotation", Point(speed=-0.01)),
    ("a left-hand turn", Point(Mode.ORIENT, 0.0, -0.5)),
    ("a turn beyond its limit", Point(Mode.ORIENT, 0.0, _FAR)),
    ("a flow beyond its limit", Point(Mode.PUMP, 0.0, 0.0, _FAR)),
    ("a flow below zero", Point(Mode.PUMP, 0.0, 0.0, -0.01)),
    ("a speed that is not a number", Point(speed=math.nan)),
    ("an infinite speed", Point(speed=math.inf)),
    ("an infinite speed to the left", Point(speed=-math.inf)),
    ("a turn that is not a number", Point(Mode.ORIENT, 0.0, math.nan)),
    ("a flow that is not a number", Point(Mode.PUMP, 0.0, 0.0, math.nan)),
    ("an unknown mode", Point(9)),
    ("the largest mode", Point(255)),
    ("a set-point that is valid for 0 s", Point(valid_for=0.0)),
    ("a set-point that is valid for a negative time", Point(valid_for=-5.0)),
    ("a validity that is not a number", Point(valid_for=math.nan)),
    ("a set-point that is valid for an infinite time", Point(valid_for=math.inf)),
):
    _misuse(_title, _sent(2, _point), "refused; the previous set-point stays in force")


# Leases that are not in force.


def _not_in_force(bench: Bench, lease: int) -> tuple[bool, str]:
    taken = bench.one().send(lease, 1, Point())
    view = bench.view()
    return not taken and view.mode not in _OBEYS, f"lease {view.lease}, mode {view.mode}"


@case("a set-point before any request", "refused")
def _no_lease(bench: Bench) -> tuple[bool, str]:
    return _not_in_force(bench, 1)


@case("a set-point with lease number 0", "refused")
def _lease_zero(bench: Bench) -> tuple[bool, str]:
    return _not_in_force(bench, 0)


_misuse("a set-point with the number of the next lease", lambda bench, lease: bench.one().send(lease + 1, 2, Point()))


@case("a set-point under a lease that was given back", "refused")
def _lease_old(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one())
    bench.one().release(lease)
    return _not_in_force(bench, lease)


@case("a set-point under the previous lease", "refused")
def _lease_before(bench: Bench) -> tuple[bool, str]:
    before = bench.take(bench.one())
    bench.one().release(before)
    lease = bench.turning()
    return _refused(bench, lease, bench.one().send(before, 2, Point()))


@case("a lease is given back twice", "the second time is refused")
def _released_twice(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one())
    done = [bench.one().release(lease), bench.one().release(lease)]
    return done == [True, False], f"{done}"


# Requests for control.


def _denied(title: str, **wish: object) -> None:
    @case(title, "denied")
    def denied(bench: Bench) -> tuple[bool, str]:
        answer = bench.ask(bench.one(), **wish)
        return answer.permission == Permission.DENIED and answer.lease == 0, f"permission {answer.permission}"


_denied("a request without a name", name="")
_denied("a request with a name of 101 characters", name="x" * 101)
_denied("a request with control characters in its name", name="x\n[driller] took control back")
_denied("a request for a negative time", duration=-1.0)
_denied("a request for a time that is not a number", duration=math.nan)
_denied("a request for an infinite time", duration=math.inf)
_denied("a request with a limit below zero", speed=-1.0)
_denied("a request with a limit that is not a number", speed=math.nan)
_denied("a request with a priority above 255", priority=256)


@case("left-hand rotation beyond the limit of the rig is requested and commanded", "the command is refused")
def _asks_left(bench: Bench) -> tuple[bool, str]:
    lease = bench.take(bench.one(), left_speed=_FAR)
    taken = bench.one().send(lease, 1, Point(speed=-100.0))
    return not taken, "refused" if not taken else "accepted"


# A person takes control back.


def _abort(title: str, before: Callable[[Bench], object]) -> None:
    @case(f"a person takes control back {title}", "the driller controls top drive and pumps")
    def abort(bench: Bench) -> tuple[bool, str]:
        before(bench)
        done = bench.person.abort()
        bench.until(lambda: bench.interface.view().mode == Mode.RELEASE)
        time.sleep(0.5)  # a waiting request must not be granted in this time
        view = bench.view()
        passed = done and (view.lease, view.mode, view.pending) == (0, Mode.RELEASE, 0)
        return passed, f"lease {view.lease}, mode {view.mode}, waiting request {view.pending}"


def _fault(bench: Bench) -> None:
    lease = bench.turning(mode=Mode.ORIENT, turn=0.2, speed=0.0)
    bench.ends(lease)


def _one_waits(bench: Bench) -> None:
    bench.take(bench.one())
    bench.ask(bench.other(), name="conformance two", wait=True)


_abort("while nobody has control", lambda _bench: None)
_abort("while a controller has control", lambda bench: bench.take(bench.one()))
_abort("while a controller rotates", Bench.turning)
_abort("while a controller turns", lambda bench: bench.turning(mode=Mode.ORIENT, turn=0.2, speed=0.0))
_abort("while a controller pumps", lambda bench: bench.turning(mode=Mode.PUMP, flow=0.01, speed=0.0))
_abort("after the lease of a silent controller has ended", _fault)
_abort("while another controller waits", _one_waits)


@case("a person takes control back without giving a name", "control is taken back")
def _abort_nameless(bench: Bench) -> tuple[bool, str]:
    bench.turning()
    done = bench.person.abort("")
    return done and bench.until(lambda: bench.interface.view().lease == 0), f"lease {bench.view().lease}"


@case("a set-point after a person has taken control back", "refused")
def _after_abort(bench: Bench) -> tuple[bool, str]:
    lease = bench.turning()
    bench.person.abort()
    taken = bench.one().send(lease, 2, Point())
    view = bench.view()
    return not taken and view.lease == 0, f"lease {view.lease}, mode {view.mode}"
