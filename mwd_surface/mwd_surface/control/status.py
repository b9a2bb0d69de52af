# SPDX-License-Identifier: Apache-2.0
"""State of control as shown by page, ROS and rig interfaces, and the records of requests and decisions."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any, ClassVar

from mwd_sensors.core.message_record import Make, MessageRecord
from mwd_sensors.core.unknown import or_nan, or_none
from mwd_surface.control.set_point import LeaseLimits, Mode


class ControlState(enum.IntEnum):
    """State of control, as in mwd_msgs/ControlState."""

    IDLE = 0
    PENDING = 1
    GRANTED = 2
    FAULT = 3


class Reaction(enum.IntEnum):
    """Reaction to the loss of controller or MWD, as in mwd_msgs/ControlState."""

    KEEP = 0
    HOLD = 1
    RELEASE = 2


class Permission(enum.IntEnum):
    """Answer to a request, as in mwd_msgs/RequestControl."""

    DENIED = 0
    PENDING = 1
    GRANTED = 2


class ControlJudgement(enum.IntEnum):
    """Decision of a person, as in mwd_msgs/JudgeControl."""

    GRANT = 0
    DENY = 1
    ABORT = 2


@dataclasses.dataclass(frozen=True)
class Sender:
    """
    Sender of a message, as far as an interface can identify senders.

    Only the sender of a request can renew the lease, send commands under the lease and give the lease back.
    """

    interface: str  #: name of the interface
    #: Text that no other sender on this interface can have, for example from a connection or a key; it is not a secret.
    identity: str

    def __str__(self) -> str:
        return f"{self.interface} {self.identity}".strip()


@dataclasses.dataclass(frozen=True)
class ControlRequest:
    """Request for control; as mwd_msgs/RequestControl."""

    sender: Sender  #: sender, who becomes the owner of the lease
    controller: str  #: name of the controller
    role: str = ""  #: purpose in a word or two
    priority: int = 0  #: 0 to 255; a priority higher than the owner's takes control from the owner
    wait: bool = False  #: whether the request waits until the owner gives control back
    duration: float = 0.0  #: length of the lease, s; 0: the longest allowed
    #: Requested limits. A limit of 0 means the limit set at the rig; a left-hand limit of 0 forbids left-hand motion.
    limits: LeaseLimits = dataclasses.field(default_factory=LeaseLimits)


@dataclasses.dataclass(frozen=True)
class ControlDecision:
    """Answer to a request: permission, number of the lease or of the pending request (0: denied), and the reason."""

    permission: Permission
    lease: int
    message: str


@dataclasses.dataclass(frozen=True)
class Achieved:
    """State reported by the rig: speed of the top drive, rad/s, torque, N m, flow, m^3/s; None if not reported."""

    speed: float | None = None
    torque: float | None = None
    flow: float | None = None


_LIMITS = tuple(field.name for field in dataclasses.fields(LeaseLimits))
_ACHIEVED = tuple(field.name for field in dataclasses.fields(Achieved))
_REACTIONS = ("controller_lost_sliding", "controller_lost_rotating", "mwd_lost_sliding", "mwd_lost_rotating")


@dataclasses.dataclass(frozen=True, eq=False)
class ControlStatus(MessageRecord):
    """State of control at one moment; the fields are those of mwd_msgs/ControlState, SI and rad."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/ControlState"
    NOT_SENT: ClassVar[frozenset[str]] = frozenset({"limits", "achieved", "reactions"})

    state: ControlState = ControlState.IDLE
    enabled: bool = False
    lease: int = 0
    owner: str = ""
    role: str = ""
    priority: int = 0
    #: `heartbeat_age`, `remaining`: time since the last heartbeat and time left of the lease, s; NaN without an owner.
    heartbeat_age: float = math.nan
    remaining: float = math.nan
    pending: int = 0
    pending_controller: str = ""
    pending_reason: str = ""
    reason: str = ""
    limits: LeaseLimits = dataclasses.field(default_factory=LeaseLimits)
    mode: Mode = Mode.RELEASE  #: mode of the top drive; RELEASE: the driller controls it
    rotary_speed: float = 0.0
    turn: float = 0.0
    flow_rate: float = math.nan  #: flow commanded to the pumps, m^3/s; NaN: the driller controls the pumps
    sequence: int = 0
    acknowledged: int = 0
    refusal: str = ""
    achieved: Achieved = dataclasses.field(default_factory=Achieved)
    #: Reactions by the name of their setting.
    reactions: Mapping[str, Reaction] = dataclasses.field(default_factory=dict)
    mwd_alive: bool = False

    @classmethod
    def from_message(cls, message: Any) -> ControlStatus:
        """Return the status in a message; the message has one field for each limit, achieved value and reaction."""
        limits = {name: float(getattr(message, f"{name}_limit")) for name in _LIMITS}
        achieved = {name: or_none(getattr(message, f"achieved_{name}")) for name in _ACHIEVED}
        return dataclasses.replace(
            super().from_message(message),
            limits=LeaseLimits(**limits),
            achieved=Achieved(**achieved),
            reactions={name: Reaction(getattr(message, name)) for name in _REACTIONS},
        )

    def to_message(self, make: Make) -> Any:
        """Return the message of this status."""
        message = super().to_message(make)
        fields = {f"{name}_limit": getattr(self.limits, name) for name in _LIMITS}
        fields |= {f"achieved_{name}": or_nan(getattr(self.achieved, name)) for name in _ACHIEVED}
        for name, value in {**fields, **{name: int(reaction) for name, reaction in self.reactions.items()}}.items():
            setattr(message, name, value)
        return message

    @property
    def asked_speed(self) -> float | None:
        """Speed commanded to the top drive, rad/s; None if no speed is commanded."""
        return self.rotary_speed if self.mode == Mode.ROTATE else None

    @property
    def asked_turn(self) -> float | None:
        """Turn commanded to the top drive, rad; None if no turn is commanded."""
        return self.turn if self.mode == Mode.ORIENT else None

    @property
    def speed_limit(self) -> float | None:
        """Speed limit of the lease, rad/s; None if control is switched off."""
        return self.limits.speed if self.enabled else None

    @property
    def flow_limit(self) -> float | None:
        """Flow limit of the lease, m^3/s; None if control is switched off."""
        return self.limits.flow if self.enabled else None
