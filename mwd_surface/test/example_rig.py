# SPDX-License-Identifier: Apache-2.0
"""What a surface node has at one moment, with every value of it set, for tests of rig interfaces."""

import contextlib
import math
import os
import pty
import select
import threading
import tty

from example_live import recorder
from example_surveys import START, S, surveys

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode, SetPoint
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import ControlRequest, Sender
from mwd_surface.live.inputs import InputState, InputTable, Role, StampClock
from mwd_surface.live.live_state import LiveState
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.rig.values import rig_values
from mwd_surface.trajectory.advice import Advice, AdviceMode

NOW = 5000.0
NOW_NS = START + 95_000 * S
INPUTS = InputTable(
    (
        InputState("sonde", StampClock.TOOL, 0.25, 1.0, 0.1),
        InputState("rig_floor", StampClock.RIG, -1.5, 2.0, 1.0, Role.IN_FORCE, 1, 650.25),
        InputState("rig_wits", StampClock.HOST, 0.0, 1.0, 1.0, Role.STANDBY, 3, 652.0, "rig_floor is used"),
    ),
    "rig_floor",
    1.0,
    1.75,
)
VALID = 1 | 2 | 4 | 8 | 32 | 64 | 128 | 256 | 1024


def attitude(status=Status.SLIDING | Status.CORRECTED, **changes):
    sample = wire.ATTITUDE.empty(1)
    values = {
        "stamp_ns": NOW_NS - S // 10,
        "inclination": math.radians(40.12),
        "azimuth": math.radians(79.5),
        "gravity_toolface": math.radians(123.456),
        "magnetic_toolface": math.radians(201.5),
        "sigma_inclination": 0.001,
        "sigma_azimuth": 0.01,
        "sigma_gravity_toolface": 0.01,
        "sigma_magnetic_toolface": 0.02,
        "status": int(status),
        "north": 3,
    }
    for name, value in {**values, **changes}.items():
        sample[name] = value
    return sample


def rig_state(**changes):
    sample = wire.RIG_STATE.empty(1)
    values = {
        "stamp_ns": NOW_NS - S,
        "bit_depth": 650.25,
        "hole_depth": 655.5,
        "block_position": 12.0,
        "hookload": 8e5,
        "torque": 5000.0,
        "rotary_speed": 1.9,
        "flow_rate": 0.03,
        "pressure": 1.5e7,
        "valid": VALID,
        "in_slips": False,
    }
    for name, value in {**values, **changes}.items():
        sample[name] = value
    return sample


def live(whole=None, sample=None, rig=None, now=NOW):
    """A LiveState that everything has just come to."""
    whole = surveys() if whole is None else whole
    state = LiveState()
    state.show(now, well=whole.well)
    gravity = wire.GRAVITY.empty(1)
    gravity["sigma"], gravity["non_gravity"], gravity["rotary_speed"] = 0.001, 0.5, 2.0
    state.on_gravity(gravity, now - 0.1)
    state.on_attitude(attitude() if sample is None else sample, now - 0.1)
    warm = wire.TEMPERATURE.empty(1)
    warm["temperature"] = 71.25
    state.on_temperature(warm, now - 0.5)
    interference = wire.INTERFERENCE.empty(1)
    interference["axial"], interference["sigma_axial"] = 8.1e-7, 5e-8
    state.on_interference(interference, now - 0.5)
    shaken = wire.DYNAMICS.empty(1)
    shaken["stick_slip_index"], shaken["lateral_rms"], shaken["shocks"] = 0.4, 3.0, 2
    state.on_dynamics(shaken, now - 0.5)
    state.on_rig_state(rig_state() if rig is None else rig, now - 1.0)
    state.show(now, surveys=whole)
    state.show(now, path=whole.definitive(bit_depth=650.25))
    state.on_recorder(recorder(), now)
    state.show(now, control=control(now))
    state.show(now, advice=ADVICE)
    state.show(now, inputs=INPUTS)
    return state


ADVICE = Advice(
    AdviceMode.SLIDE,
    toolface=1.0,
    limit=0.25,
    sigma=0.1,
    confidence=0.98,
    from_depth=650.25,
    slide_to_depth=660.0,
    to_depth=678.25,
    source="plan",
    reason="for the test",
)


def control(now):
    """A controller that rotates the string and pumps."""
    authority = ControlAuthority(ControlSettings(enabled=True, grant="automatic"), first=70_000)
    sender = Sender("Modbus", "connection 1")
    lease = authority.request(ControlRequest(sender, "modbus 5", priority=9), now).lease
    authority.command(SetPoint(Mode.PUMP, lease, 1, flow_rate=0.03), now, sender)
    authority.command(SetPoint(Mode.ROTATE, lease, 2, rotary_speed=2.0), now, sender)
    # The ramp makes up for no more than its longest step at a time.
    for later in (0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 1.9):
        sent = authority.update(now + later)
    authority.on_acknowledge(lease, sent[0].sequence, True, "")
    return authority.status(now)


def values(whole=None, sample=None, rig=None, later=0.0, **changes):
    """RigValues of that moment, or some seconds later with nothing new."""
    whole = surveys() if whole is None else whole
    state = live(whole, sample, rig).at(NOW + later)
    return rig_values(state, accepted_surveys(whole), now_ns=NOW_NS + round(later * S), **changes)


@contextlib.contextmanager
def started(interface):
    """An interface that runs, and is stopped whatever happens."""
    interface.start()
    try:
        yield interface
    finally:
        interface.stop()


async def certified(folder, name):
    """A client's own certificate: the paths of it and of its key."""
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key, certificate = folder / f"{name}.pem", folder / f"{name}.der"
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    await setup_self_signed_certificate(key, certificate, f"urn:test:{name}", "localhost", uses, {"commonName": name})
    return certificate, key


@contextlib.contextmanager
def pseudo_terminal():
    """A serial line: a descriptor of one end, and the name of the device at the other end."""
    far, near = pty.openpty()
    try:
        tty.setraw(far)
        tty.setraw(near)
        yield far, os.ttyname(near)
    finally:
        os.close(far)
        os.close(near)


@contextlib.contextmanager
def extended(line):
    """A device for a program that needs a name: bytes are carried between it and the descriptor of a line."""
    ended = threading.Event()
    with pseudo_terminal() as (far, device):

        def carry():
            while not ended.is_set():
                for end in select.select([line, far], [], [], 0.05)[0]:
                    os.write(far if end == line else line, os.read(end, 4096))

        wire = threading.Thread(target=carry)
        wire.start()
        try:
            yield device
        finally:
            ended.set()
            wire.join()
