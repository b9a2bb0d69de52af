# SPDX-License-Identifier: Apache-2.0
"""
Control authority: a state machine that gives one controller at a time a lease over top drive and pumps.

The state machine follows the D-WIS interface to a drilling control system (ADCS): a request is granted, pending or
denied; the owner of the lease sends set-points and a heartbeat; the loss of the controller or of the MWD causes a
reaction set in advance. The owner can prolong a lease and command within the granted limits, and nobody else can use
the lease. The machine reads no clock: every call takes `now`, s, of one steady clock, and first ends the leases,
requests and set-points that have expired by then. Several threads may call it: page and rig interfaces have their own
threads.

A part of the surface node that needs the rig, for example a downlink, is a controller like any other::

    me = Sender("surface", "downlink")
    decision = authority.request(ControlRequest(me, "downlink", priority=50), now)
    if decision.permission == Permission.GRANTED:
        authority.command(SetPoint(Mode.PUMP, decision.lease, 1, flow_rate=0.02), now, me)
        ...                                         # send sequence 0 (heartbeat) at least once in heartbeat_s
    authority.release(decision.lease, now, me)  # the driller's settings apply again
"""

from __future__ import annotations

import dataclasses
import math
import threading

from mwd_sensors.core.foreign_text import unprintable
from mwd_surface.control.set_point import LARGEST_NUMBER, LeaseLimits, Mode, SetPoint, check, ramped
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import (
    Achieved,
    ControlDecision,
    ControlJudgement,
    ControlRequest,
    ControlState,
    ControlStatus,
    Permission,
    Reaction,
    Sender,
)

# Commands to the rig.

RIG_TIMEOUT = 2.0  # time without a command after which the rig reacts by itself, s
_REFRESH = 0.5  # time between repetitions of a command, s
_MOST_UNANSWERED = 100  # largest number of commands whose answer is still expected; older commands are forgotten
# Longest time step of a ramp, s. The surface calls `due` ten times per second. After a pause of the process the speed
# must not jump to the value that the ramp would have reached during the pause.
_LONGEST_STEP = 0.2


@dataclasses.dataclass
class _DriveChannel:
    """State of the top drive or of the pumps."""

    point: SetPoint | None = None  #: set-point in force; None: the driller has control
    lapses: float = math.inf  #: end of its validity, steady time, s
    set: int = 0  #: counter of set-points
    #: `key`, `number`, `sent_at`: content of the last command sent to the rig, its number, and its time, s.
    key: tuple[int, float] = (0, 0.0)
    number: int = 0
    sent_at: float = -math.inf


class RigCommands:
    """
    Commands to the rig and their timing.

    Parameters
    ----------
    returns : bool
        Whether a rotating top drive returns to the driller's settings when no further commands arrive; otherwise the
        rig holds the string.
    """

    def __init__(self, *, returns: bool) -> None:
        self._returns = returns
        self._drive, self._pump = _DriveChannel(), _DriveChannel()
        self._speed = self._ramp_at = 0.0
        self._limits = LeaseLimits()
        self._sets = self._counter = 0
        self._unanswered: dict[int, int] = {}
        self._release_due = False

    @property
    def drive(self) -> SetPoint | None:
        """Set-point of the top drive; None if the driller controls the top drive."""
        return self._drive.point

    @property
    def pump(self) -> SetPoint | None:
        """Set-point of the pumps; None if the driller controls the pumps."""
        return self._pump.point

    @property
    def speed(self) -> float:
        """Commanded speed of the top drive at this point of its ramp, rad/s; 0 unless rotation is commanded."""
        return self._speed if self.drive is not None and self.drive.mode == Mode.ROTATE else 0.0

    @property
    def active(self) -> bool:
        """Whether any set-point is in force."""
        return self.drive is not None or self.pump is not None

    @property
    def rotating(self) -> bool:
        """Whether the top drive is commanded to rotate."""
        return self.drive is not None and self.drive.mode == Mode.ROTATE

    def limit(self, limits: LeaseLimits) -> None:
        """Set the limits; if a set-point or the present speed of the ramp exceeds them, give control to the driller."""
        self._limits = limits
        if self.rotating and not -limits.left_speed <= self._speed <= limits.speed:
            self.let_go()
        for point in (self.drive, self.pump):
            if point is not None:
                try:
                    check(point, limits)
                except ValueError:
                    self.let_go()

    def take(self, point: SetPoint, achieved_speed: float, now: float) -> None:
        """Put a checked set-point into force; achieved_speed: present speed, rad/s, at which a ramp begins."""
        if point.mode == Mode.RELEASE:
            self.let_go()
        elif point.mode == Mode.PUMP:
            self._set(self._pump, point, now + point.valid_for)
        else:
            if point.mode == Mode.ROTATE and not self.rotating:
                # The ramp begins at the driller's speed; after holding, the string begins at rest.
                speed = achieved_speed if self.drive is None else 0.0
                self._speed = min(max(speed, -self._limits.left_speed), self._limits.speed)
                self._ramp_at = now
            self._set(self._drive, point, now + point.valid_for)

    def hear(self, now: float) -> None:
        """Process a heartbeat: restart the validity of both set-points, except of a set-point without a time limit."""
        for channel in (self._drive, self._pump):
            if channel.point is not None and math.isfinite(channel.lapses):
                channel.lapses = now + channel.point.valid_for

    def hold(self) -> None:
        """Command the top drive to hold the string, without a time limit."""
        self._set(self._drive, SetPoint(Mode.HOLD, 0, 1), math.inf)

    def keep(self) -> None:
        """Keep the set-point of the top drive without a time limit."""
        self._drive.lapses = math.inf

    def let_go(self) -> None:
        """Give top drive and pumps back to the driller."""
        self._release_due = self._release_due or self.active
        self._drive.point = self._pump.point = None

    def stop_pump(self) -> None:
        """
        Give the pumps back to the driller; a set-point of the top drive stays in force.

        If there is no set-point of the top drive, send the rig the command to release everything. Otherwise the flow is
        simply no longer commanded.
        """
        if self.drive is None:
            self.let_go()
        # As soon as the command is no longer repeated, the rig ends the commanded flow by itself.
        self._pump.point = None

    def lapse(self, now: float) -> None:
        """
        End the set-points whose validity is over.

        The top drive then holds the string, or is given back with the pumps if it rotates and the set-point has
        `returns`. Pumps are given back to the driller.
        """
        drive = self.drive
        if drive is not None and now >= self._drive.lapses:
            if drive.mode == Mode.ROTATE and drive.returns:
                self.let_go()
            elif drive.mode != Mode.HOLD:
                self.hold()
        if self.pump is not None and now >= self._pump.lapses:
            self.stop_pump()

    def due(self, lease: int, sequence: int, now: float) -> list[SetPoint]:
        """
        Return the commands to send to the rig now; sequence: number of the controller's set-point in force.

        A command is sent if it has changed, and repeated every `_REFRESH`. When the lease ends, one command RELEASE is
        sent alone.
        """
        if self._release_due:
            self._release_due = False
            return [SetPoint(Mode.RELEASE, lease, self._number(sequence), valid_for=RIG_TIMEOUT)]
        found = []
        for channel in (self._drive, self._pump):
            point = channel.point
            if point is None:
                continue
            if point.mode == Mode.ROTATE:
                step = min(now - self._ramp_at, _LONGEST_STEP)
                self._speed = ramped(self._speed, point.rotary_speed, self._limits.speed_rate, step)
                self._ramp_at = now
                point = dataclasses.replace(point, rotary_speed=self._speed, returns=self._returns)
            key = channel.set, point.rotary_speed
            if key == channel.key and now - channel.sent_at < _REFRESH:
                continue
            if key != channel.key:
                channel.key, channel.number = key, self._number(sequence)
            channel.sent_at = now
            found.append(dataclasses.replace(point, lease=lease, sequence=channel.number, valid_for=RIG_TIMEOUT))
        return found

    def answered(self, number: int) -> int:
        """
        Return the number of the controller's set-point that led to an answered command; 0 if no answer is expected.

        number: number of the command to the rig.
        """
        return self._unanswered.pop(number, 0)

    def _set(self, channel: _DriveChannel, point: SetPoint, lapses: float) -> None:
        self._sets += 1
        channel.point, channel.lapses, channel.set = point, lapses, self._sets

    def _number(self, sequence: int) -> int:
        self._counter += 1
        self._unanswered[self._counter] = sequence
        while len(self._unanswered) > _MOST_UNANSWERED:
            del self._unanswered[next(iter(self._unanswered))]
        return self._counter


# Authority.

_SWITCHED_OFF = "control is switched off at this rig; set control.enabled to allow it"
_TORQUE_TIME = 1.0  # time above the torque limit after which the lease ends, s; stick-slip peaks are shorter
_LONGEST_NAME = 100  # largest number of characters of the name or the role of a controller
# Largest step back of `now`, s, that calls of several threads out of order can cause. After a larger step the clock
# counts as set back.
_CLOCK_BACK = 1.0
_WORDS = {
    Reaction.KEEP: "the last set-point stays in force until a person or a new lease ends it",
    Reaction.HOLD: "the string is held until a person or a new lease ends it",
    Reaction.RELEASE: "top drive and pumps are back with the driller",
}


@dataclasses.dataclass
class _Lease:
    """Lease or waiting request."""

    number: int
    request: ControlRequest
    limits: LeaseLimits
    #: `since`, `ends`, `heard`: times of the request, of the end of the lease, and of the last message that proves that
    #: the controller is alive; steady time, s.
    since: float
    ends: float
    heard: float
    waits: str = ""  #: reason why a request waits; empty for a lease

    @property
    def name(self) -> str:
        return self.request.controller

    @property
    def sender(self) -> Sender:
        return self.request.sender


class ControlAuthority:
    """
    State machine that grants, watches and ends leases.

    Parameters
    ----------
    first : int
        Number of the first lease; `upcoming` is the number of the next lease. A rig obeys no lease with a lower number
        than the highest that it has received, so numbers must continue after a restart (`lease_numbers`).
    closed : str
        Reason why control is not available, with the remedy; empty: the settings decide.
    """

    def __init__(self, settings: ControlSettings, first: int = 1, closed: str = "") -> None:
        self.settings, self._closed = settings, closed
        #: Number of set-points and heartbeats that were refused, and of releases by another sender than the owner.
        self.refused = 0
        self._site = LeaseLimits.of_settings(settings)
        self._reactions = {
            f"{what}_{how}": Reaction[getattr(settings, f"{what}_{how}").upper()]
            for what in ("controller_lost", "mwd_lost")
            for how in ("sliding", "rotating")
        }
        self._lock = threading.RLock()
        self.upcoming, self._newest = first, 0
        self._lease: _Lease | None = None
        self._pending: _Lease | None = None
        self._rig = RigCommands(returns=self._reactions["controller_lost_rotating"] == Reaction.RELEASE)
        self._sequence = self._acknowledged = 0
        self._refusal = self._reason = ""
        self._fault = ""
        self._achieved, self._torque_since = Achieved(), math.inf
        self._mwd_alive = True
        self._now = -math.inf
        self._events: list[str] = []

    # Requests and decisions.

    def request(self, request: ControlRequest, now: float) -> ControlDecision:
        """
        Return the decision on a request for control.

        A new request of the owner prolongs the owner's lease within what was granted.
        """
        with self._lock:
            now = self._pass(now)
            try:
                limits = self._checked(request)
            except ValueError as error:
                return _denied(str(error))
            if self._closed or not self.settings.enabled:
                return _denied(self._closed or _SWITCHED_OFF)
            for lease in (self._lease, self._pending):
                if lease is not None and (lease.sender == request.sender) != (lease.name == request.controller):
                    return _denied(_not_the_same(lease, request))
            owner = self._lease
            if owner is not None and owner.sender == request.sender:
                return self._renew(owner, request, limits, now)
            return self._decide(request, limits, now)

    def _renew(self, owner: _Lease, request: ControlRequest, limits: LeaseLimits, now: float) -> ControlDecision:
        """
        Prolong a lease and return the decision.

        A request for wider limits, a higher priority or a later end than granted is denied.
        """
        beyond = limits.beyond(owner.limits)
        if request.priority > owner.request.priority:
            beyond.append("priority")
        if self._end(request, now) > self._end(owner.request, now):
            beyond.append("duration")
        if beyond:
            text = "a lease can only be prolonged as it was granted; to get more, give the lease back and ask again"
            return _denied(f"{', '.join(beyond)}: the request is for more than the lease grants: {text}")
        owner.heard, owner.ends = now, max(owner.ends, self._end(request, now))
        return ControlDecision(Permission.GRANTED, owner.number, "renewed within the limits of the lease")

    def _decide(self, request: ControlRequest, limits: LeaseLimits, now: float) -> ControlDecision:
        owner, pending = self._lease, self._pending
        if pending is not None and pending.sender == request.sender:
            return ControlDecision(Permission.PENDING, pending.number, pending.waits)
        stronger = owner if owner is not None and owner.request.priority >= request.priority else None
        if stronger is not None and not request.wait:
            priority = stronger.request.priority
            text = f"{stronger.name} has control, priority {priority}; set wait in the request, or ask later"
            return _denied(text)
        if pending is not None and pending.request.priority >= request.priority:
            return _denied(f"a request of {pending.name} is already waiting; ask later")
        if self.upcoming > LARGEST_NUMBER:
            return _denied("all lease numbers of this well are used; give the well another folder")
        lease = _Lease(self.upcoming, request, limits, now, math.inf, now)
        self.upcoming += 1
        if stronger is None and self.settings.grant == "automatic":
            self._grant(lease, now, "granted automatically")
            return ControlDecision(Permission.GRANTED, lease.number, "granted")
        reasons = ["for a person to grant it"] if self.settings.grant == "operator" else []
        if stronger is not None:
            reasons.insert(0, f"for {stronger.name} to give control back")
        lease.waits = f"waits {' and '.join(reasons)}"
        self._pending = lease
        self._log(f"{lease.name} asks for control and {lease.waits}")
        return ControlDecision(Permission.PENDING, lease.number, lease.waits)

    def judge(self, judgement: int, operator: str, now: float, reason: str = "", number: int = 0) -> tuple[bool, str]:
        """
        Carry out a person's decision; return whether the decision was carried out, and a message.

        operator: name of the person, required except to abort. number: number of the request that the page showed to
        the person. 0 stands for the waiting request, but is not accepted for granting.
        """
        with self._lock:
            now = self._pass(now)
            because = f": {reason}" if reason else ""
            if judgement == ControlJudgement.ABORT:
                self._abort(operator.strip() or "somebody without a name", because)
                return True, "the driller controls top drive and pumps"
            if not operator.strip():
                return False, "operator_name: must not be empty: the log records who did it"
            if judgement not in (ControlJudgement.GRANT, ControlJudgement.DENY):
                return False, "decision: must be 0 (grant), 1 (deny) or 2 (abort)"
            pending = self._pending
            if pending is None:
                return False, "no request waits"
            if number != pending.number and (number or judgement == ControlJudgement.GRANT):
                missing = "number: must be the number of the waiting request"
                which = f"request {number} is no longer waiting" if number else missing
                return False, f"{which}; request {pending.number} of {pending.name} waits"
            self._pending = None
            if judgement == ControlJudgement.GRANT:
                self._grant(pending, now, f"granted by {operator}{because}")
                return True, f"{pending.name} has control"
            self._reason = f"{operator} denied control to {pending.name}{because}"
            self._log(self._reason)
            return True, f"{pending.name} is denied"

    def _abort(self, operator: str, because: str) -> None:
        """
        Give top drive and pumps back to the driller, whether or not a lease is in force.

        A waiting request is dropped, because it would be granted as soon as the lease has ended.
        """
        if self._pending is not None:
            self._log(f"the request of {self._pending.name} ended: {operator} took control back")
            self._pending = None
        if self._lease is not None or self._rig.active or self._fault:
            self._end_lease(f"{operator} took control back{because}", Reaction.RELEASE)

    def release(self, lease: int, now: float, sender: Sender, reason: str = "") -> tuple[bool, str]:
        """Give back a lease, or withdraw a request, of this sender; return whether this was done, and a message."""
        with self._lock:
            self._pass(now)
            because = f": {reason}" if reason else ""
            found = [one for one in (self._pending, self._lease) if one is not None and one.number == lease]
            if not found:
                return False, f"lease {lease} is not in force"
            if found[0].sender != sender:
                self.refused += 1
                return False, f"lease {lease} belongs to {found[0].name}; only {found[0].name} can give it back"
            if found[0] is self._pending:
                self._log(f"{found[0].name} withdrew the request for control{because}")
                self._pending = None
                return True, "withdrawn"
            self._end_lease(f"{found[0].name} gave control back{because}", Reaction.RELEASE)
            return True, "the driller controls top drive and pumps"

    def _checked(self, request: ControlRequest) -> LeaseLimits:
        for name in ("controller", "role"):
            text = getattr(request, name)
            if fault := unprintable(text):
                raise ValueError(f"{name}: {fault}")
            if len(text) > _LONGEST_NAME:
                raise ValueError(f"{name}: at most {_LONGEST_NAME} characters, got {len(text)}")
        if not request.controller.strip():
            raise ValueError("controller: must not be empty: people must see who has control")
        if not 0 <= request.priority <= 255:
            raise ValueError(f"priority: must be within 0 and 255, got {request.priority}")
        if not (math.isfinite(request.duration) and request.duration >= 0.0):
            raise ValueError(f"duration: must be finite and not below 0, got {request.duration:g}")
        return request.limits.within(self._site)

    def _end(self, request: ControlRequest, now: float) -> float:
        longest = self.settings.longest_s
        return now + (min(request.duration, longest) if request.duration > 0.0 else longest)

    def _grant(self, lease: _Lease, now: float, how: str) -> None:
        if self._lease is not None:
            self._log(f"{self._lease.name} loses control to {lease.name}")
        lease.heard, lease.ends = now, self._end(lease.request, now)
        self._lease, self._newest = lease, lease.number
        # Keep the set-points in force if they are within the new owner's limits, so that the string does not jerk.
        self._rig.limit(lease.limits)
        self._sequence = self._acknowledged = 0
        self._refusal = self._reason = self._fault = ""
        self._log(f"{lease.name} has control, {how}")

    def _end_lease(self, reason: str, reaction: Reaction) -> None:
        self._lease = None
        if self._rig.drive is None:
            reaction = Reaction.RELEASE
        self._react(reaction)
        if reaction != Reaction.RELEASE:
            # Without an owner nobody watches the pumps, so stop them even if the string holds or rotates on.
            self._rig.stop_pump()
        self._fault = "" if reaction == Reaction.RELEASE else "ownerless"
        self._refusal, self._torque_since = "", math.inf
        self._reason = f"{reason}: {_WORDS[reaction]}"
        self._log(self._reason)

    def _react(self, reaction: Reaction) -> None:
        if reaction == Reaction.RELEASE:
            self._rig.let_go()
        elif reaction == Reaction.HOLD:
            self._rig.hold()
        else:
            self._rig.keep()

    # Set-points and observations.

    def command(self, point: SetPoint, now: float, sender: Sender) -> tuple[bool, str]:
        """
        Process a set-point or, with sequence number 0, a heartbeat of the owner.

        Return whether the message was accepted, and the reason if it was refused. A refused set-point changes nothing
        in force and does not count as a heartbeat, because its controller does not work properly.
        """
        with self._lock:
            now = self._pass(now)
            owner = self._lease
            if owner is None or point.lease != owner.number:
                self.refused += 1
                holder = "nobody has control" if owner is None else f"{owner.name} has control"
                return False, f"lease {point.lease} is not in force: {holder}"
            if sender != owner.sender:
                # The lease number does not prove the identity, because every client can read it.
                self.refused += 1
                return False, f"lease {point.lease} belongs to {owner.name}; only {owner.name} can command under it"
            if point.sequence == 0:
                owner.heard = now
                self._rig.hear(now)
                return True, ""
            try:
                self._check_number(point.sequence)
                check(point, owner.limits)
                self._check_mwd(point.mode)
            except ValueError as error:
                self.refused += 1
                self._refusal = str(error)
                return False, self._refusal
            owner.heard = now
            self._sequence, self._refusal = point.sequence, ""
            if self._mwd_alive:
                self._fault = self._reason = ""
            self._rig.take(point, self._achieved.speed or 0.0, now)
            return True, ""

    def _check_number(self, sequence: int) -> None:
        if sequence <= self._sequence:
            text = f"{sequence} is not above {self._sequence}, the last that was accepted"
            raise ValueError(f"sequence: {text}; number 0 is a heartbeat")

    def _check_mwd(self, mode: int) -> None:
        needed = {Mode.ORIENT: "mwd_lost_sliding", Mode.ROTATE: "mwd_lost_rotating"}.get(Mode(mode))
        if not self._mwd_alive and needed is not None and self._reactions[needed] != Reaction.KEEP:
            raise ValueError("the MWD is silent: hold or release until its attitude is back")

    def on_acknowledge(self, lease: int, number: int, obeyed: bool, message: str) -> None:
        """Process the rig's answer to a command; lease, number: lease and sequence number of the answered command."""
        with self._lock:
            asked = self._rig.answered(number)
            if self._lease is None or lease != self._lease.number or asked != self._sequence:
                return
            if obeyed:
                self._acknowledged, self._refusal = asked, ""
            else:
                self._refusal = f"the rig refuses: {message}"

    def on_rig(self, achieved: Achieved, now: float) -> None:
        """Store the state that the rig reports, and the time since which its torque is above the limit."""
        with self._lock:
            self._achieved = achieved
            limit = math.inf if self._lease is None else self._lease.limits.torque
            above = achieved.torque is not None and abs(achieved.torque) > limit
            self._torque_since = min(self._torque_since, now) if above else math.inf

    def on_mwd(self, alive: bool) -> None:
        """
        Store whether attitude and toolface arrive; start the configured reaction if they stop.

        There is no reaction without a lease, or while the driller controls the top drive.
        """
        with self._lock:
            lost, self._mwd_alive = self._mwd_alive and not alive, alive
            if alive and self._fault == "mwd":
                self._fault = self._reason = ""
            if not lost or self._lease is None or self._rig.drive is None:
                return
            how = "rotating" if self._rig.rotating else "sliding"
            reaction = self._reactions[f"mwd_lost_{how}"]
            if reaction != Reaction.KEEP:
                self._react(reaction)
                self._fault = "mwd"
                self._reason = f"the MWD went silent while {how}: {_WORDS[reaction]}"
                self._log(self._reason)

    # Periodic update and expiry.

    def update(self, now: float) -> list[SetPoint]:
        """
        Advance the time and return the commands that are due to the rig; called about ten times per second.

        If requests are granted automatically and no lease is held, a waiting request is granted first.
        """
        with self._lock:
            now = self._pass(now)
            if self._lease is None and self._pending is not None and self.settings.grant == "automatic":
                pending, self._pending = self._pending, None
                self._grant(pending, now, "granted automatically")
            return self._rig.due(self._newest, self._sequence, now)

    def _pass(self, now: float) -> float:
        """
        End leases, requests and set-points that have expired by `now`.

        If `now` goes back by more than a second, a lease and a waiting request end too. Return the time in force, s,
        which goes back only in that case.
        """
        if now < self._now - _CLOCK_BACK:
            # After the clock has gone back, the remaining durations are unknown: end lease and request.
            self._now, self._pending = now, None
            if self._lease is not None:
                reaction = self._reactions[f"controller_lost_{'rotating' if self._rig.rotating else 'sliding'}"]
                self._end_lease(f"the clock went back while {self._lease.name} had control", reaction)
        self._now = now = max(self._now, now)
        pending = self._pending
        if pending is not None and now - pending.since > self.settings.pending_s:
            self._pending = None
            self._reason = f"the request of {pending.name} lapsed"
            self._log(self._reason)
        if self._lease is not None:
            self._watch(self._lease, now)
        if self._lease is not None:
            self._rig.lapse(now)
        return now

    def _watch(self, owner: _Lease, now: float) -> None:
        if now - owner.heard > self.settings.heartbeat_s:
            reaction = self._reactions[f"controller_lost_{'rotating' if self._rig.rotating else 'sliding'}"]
            self._end_lease(f"{owner.name} is silent for {now - owner.heard:.1f} s", reaction)
        elif now - self._torque_since >= _TORQUE_TIME:
            self._end_lease(f"torque above {owner.limits.torque:.0f} N m while {owner.name} had control", Reaction.HOLD)
        elif now >= owner.ends:
            self._end_lease(f"the lease of {owner.name} is over", Reaction.RELEASE)

    # Status and events for people.

    def status(self, now: float) -> ControlStatus:
        """Return the state of control at `now`."""
        with self._lock:
            rig, drive, pump = self._rig, self._rig.drive, self._rig.pump
            state = ControlState.PENDING if self._pending is not None else ControlState.IDLE
            state = ControlState.GRANTED if self._lease is not None else state
            status = ControlStatus(
                state=ControlState.FAULT if self._fault else state,
                enabled=self.settings.enabled,
                reason=self._closed or self._reason,
                limits=self._site if self._lease is None else self._lease.limits,
                mode=Mode.RELEASE if drive is None else Mode(drive.mode),
                rotary_speed=rig.speed,
                turn=0.0 if drive is None else drive.turn,
                flow_rate=math.nan if pump is None else pump.flow_rate,
                sequence=self._sequence,
                acknowledged=self._acknowledged,
                refusal=self._refusal,
                achieved=self._achieved,
                reactions=self._reactions,
                mwd_alive=self._mwd_alive,
            )
            if self._pending is not None:
                number, name, waits = self._pending.number, self._pending.name, self._pending.waits
                status = dataclasses.replace(status, pending=number, pending_controller=name, pending_reason=waits)
            owner = self._lease
            if owner is None:
                return status
            return dataclasses.replace(
                status,
                lease=owner.number,
                owner=owner.name,
                role=owner.request.role,
                priority=owner.request.priority,
                heartbeat_age=max(0.0, now - owner.heard),
                remaining=max(0.0, owner.ends - now),
            )

    def drain_events(self) -> list[str]:
        """Return and clear the events since the last call, as sentences for the log."""
        with self._lock:
            events, self._events = self._events, []
            return events

    def _log(self, text: str) -> None:
        self._events.append(text)


def _denied(message: str) -> ControlDecision:
    return ControlDecision(Permission.DENIED, 0, message)


def _not_the_same(lease: _Lease, request: ControlRequest) -> str:
    """Return the reason to deny a request that shares only sender or only name with a lease or waiting request."""
    if lease.sender == request.sender:
        return f"controller: you already are {lease.name}; give lease {lease.number} back to ask under another name"
    return f"controller: {lease.name} is the name of another controller on {lease.sender.interface}; use another name"
