# SPDX-License-Identifier: Apache-2.0
"""
Connection between the surface node and all rig interfaces: values go out, rig data and commands come back.

Each enabled interface is started separately. An interface that cannot start reports the reason and is retried while the
others run. If no values are published for a while, every interface gets stale values and the heartbeat stops.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
import time
from collections.abc import Callable
from pathlib import Path

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import setting
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS
from mwd_surface.rig.blackboard.client import Blackboard, BlackboardSettings
from mwd_surface.rig.interface import (
    DOWN,
    InterfaceError,
    InterfaceStatus,
    OnCommand,
    OnRigState,
    RigInterface,
)
from mwd_surface.rig.modbus.server import ModbusSerial, ModbusSerialSettings, ModbusServer, ModbusSettings
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.server import OpcuaServer
from mwd_surface.rig.polled.unit import PolledSettings, PolledUnit
from mwd_surface.rig.values import RigValues, silenced
from mwd_surface.rig.wits.connections import (
    Wits0Client,
    Wits0ClientSettings,
    Wits0Serial,
    Wits0SerialSettings,
    Wits0Server,
    Wits0ServerSettings,
)
from mwd_surface.rig.wits.link import Wits0Settings
from mwd_surface.rig.witsml.store import WitsmlStore, WitsmlStoreSettings

_LOOK = 0.5  # time between checks for new values and for interfaces that ended, s


@dataclasses.dataclass(frozen=True)
class RigSettings:
    """Settings of all rig interfaces; each interface is off by default."""

    wits0: Wits0Settings = setting(Wits0Settings, "Settings common to all WITS interfaces.")
    wits0_server: Wits0ServerSettings = setting(Wits0ServerSettings, "WITS server, to which recorders connect.")
    wits0_client: Wits0ClientSettings = setting(Wits0ClientSettings, "WITS client, which connects to a recorder.")
    wits0_serial: Wits0SerialSettings = setting(Wits0SerialSettings, "WITS over a serial line.")
    opcua: OpcuaSettings = setting(OpcuaSettings, "OPC UA server.")
    modbus: ModbusSettings = setting(ModbusSettings, "Modbus TCP server.")
    modbus_serial: ModbusSerialSettings = setting(ModbusSerialSettings, "Modbus RTU server on a serial line.")
    polled: PolledSettings = setting(PolledSettings, "Polled serial line of another maker's surface unit.")
    witsml_store: WitsmlStoreSettings = setting(WitsmlStoreSettings, "Client of a WITSML store.")
    blackboard: BlackboardSettings = setting(BlackboardSettings, "Client of a D-WIS blackboard.")
    strict: bool = setting(
        False, "Refuse to start if an interface cannot start. If false, try again every retry_period."
    )
    retry_period: float = setting(
        10.0,
        "Time between attempts to start an interface that could not start. Raising it lets such an interface "
        "start later.",
        unit="s",
        low=0.05,
        high=3600.0,
    )
    silent_after: float = setting(
        3.0,
        "Time without new values from the surface node after which the interfaces mark all values as invalid. "
        "Raise it for a slow computer.",
        unit="s",
        low=0.2,
        high=60.0,
    )

    @property
    def takes_data(self) -> bool:
        """Whether an interface may receive rig data, so that the surface must publish `rig/state`."""
        talks = self.wits0_server.enabled or self.wits0_client.enabled or self.wits0_serial.enabled
        registers = self.modbus.enabled or self.modbus_serial.enabled
        board = self.blackboard.enabled and self.blackboard.rig.accept
        return board or (talks and self.wits0.rig.accept) or (registers and self.modbus.allow_writes)


class RigPort:
    """
    All rig interfaces of one well.

    Parameters
    ----------
    on_rig_state : callable, optional
        `on_rig_state(frame, samples)`, called in a thread of the interface; frame: frame id that names the interface,
        samples: `wire.RIG_STATE` samples from the rig.
    on_command : callable, optional
        `on_command(name, arguments) -> (ok, message)`, called in a thread of an interface.
    folder : Path, optional
        Folder for certificates.
    authority : ControlAuthority, optional
        Decides on the requests of controllers that connect through OPC UA or Modbus.
    clock : callable
        Steady time, s.
    """

    def __init__(
        self,
        settings: RigSettings,
        well: str = "well",
        on_rig_state: Callable[[str, Samples], None] | None = None,
        on_command: OnCommand | None = None,
        folder: Path | None = None,
        authority: ControlAuthority | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.settings = settings
        self._clock = clock
        talk = settings.wits0

        def named(frame: str) -> OnRigState | None:
            return None if on_rig_state is None else functools.partial(on_rig_state, frame)

        interfaces: tuple[tuple[bool, Callable[[], RigInterface]], ...] = (
            (settings.wits0_server.enabled, lambda: Wits0Server(settings.wits0_server, talk, named(WITS))),
            (settings.wits0_client.enabled, lambda: Wits0Client(settings.wits0_client, talk, named(WITS))),
            (settings.wits0_serial.enabled, lambda: Wits0Serial(settings.wits0_serial, talk, named(WITS))),
            (settings.opcua.enabled, lambda: OpcuaServer(settings.opcua, well, on_command, folder, authority)),
            (settings.modbus.enabled, lambda: ModbusServer(settings.modbus, named(MODBUS), authority)),
            (
                settings.modbus_serial.enabled,
                lambda: ModbusSerial(settings.modbus_serial, settings.modbus, named(MODBUS), authority),
            ),
            (settings.polled.enabled, lambda: PolledUnit(settings.polled)),
            (settings.blackboard.enabled, lambda: Blackboard(settings.blackboard, named(OPCUA))),
        )
        self._interfaces = [make() for enabled, make in interfaces if enabled]
        self._store = WitsmlStore(settings.witsml_store) if settings.witsml_store.enabled else None
        if self._store is not None:
            self._interfaces.append(self._store)
        self._down: dict[str, str] = {}
        self._lock = threading.Lock()
        self._values: RigValues | None = None
        self._published_at = 0.0
        self._silent = False
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def enabled(self) -> bool:
        """Whether any interface is enabled."""
        return bool(self._interfaces)

    def start(self) -> dict[str, str]:
        """
        Start the enabled interfaces.

        Returns
        -------
        dict
            Name and reason of every interface that could not start; each is tried again, even if a package is missing.

        Raises
        ------
        InterfaceError
            An interface could not start and `strict` is set; then all interfaces are stopped.
        """
        self._ended.clear()
        for interface in self._interfaces:
            self._try(interface)
        if self._down and self.settings.strict:
            self.stop()
            raise InterfaceError("; ".join(f"{name}: {why}" for name, why in self._down.items()))
        if self._interfaces:
            self._thread = threading.Thread(target=self._watch, name="rig-port", daemon=True)
            self._thread.start()
        return dict(self._down)

    def publish(self, values: RigValues) -> None:
        """Give the newest values to every interface; never blocks."""
        with self._lock:
            self._values, self._published_at, self._silent = values, self._clock(), False
        for interface in self._interfaces:
            interface.publish(values)

    def publish_trajectory(self, document: str) -> None:
        """Give the definitive survey, a WITSML document, to the client of the WITSML store; never blocks."""
        if self._store is not None:
            self._store.push(document)

    @property
    def wants_trajectory(self) -> bool:
        """Whether a WITSML store is configured, to which the definitive survey is pushed."""
        return self._store is not None

    def status(self) -> tuple[InterfaceStatus, ...]:
        """Return the state of each interface."""
        table = []
        for interface in self._interfaces:
            status = interface.status()
            if interface.name in self._down:
                status = dataclasses.replace(status, state=DOWN, reason=self._down[interface.name])
            table.append(status)
        return tuple(table)

    def stop(self) -> None:
        """Stop every interface; does nothing if no interface runs."""
        self._ended.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(timeout=5.0)
        for interface in self._interfaces:
            interface.stop()

    def _try(self, interface: RigInterface) -> None:
        try:
            interface.start()
        except InterfaceError as error:
            self._down[interface.name] = str(error)
        else:
            self._down.pop(interface.name, None)
            if self._values is not None:
                interface.publish(self._values)

    def _watch(self) -> None:
        """Start again interfaces that are down, and publish the last values as unusable when no new values come."""
        tried = self._clock()
        while not self._ended.wait(min(_LOOK, self.settings.retry_period)):
            now = self._clock()
            if now - tried >= self.settings.retry_period:
                tried = now
                for interface in self._interfaces:
                    state = interface.status()
                    if interface.name in self._down or (state.reason and state.state == "stopped"):
                        self._try(interface)
            self._publish_silence(now)

    def _publish_silence(self, now: float) -> None:
        with self._lock:
            values, age = self._values, now - self._published_at
            if values is None or self._silent or age < self.settings.silent_after:
                return
            self._silent = True
        quiet = silenced(values, age, "the surface node is silent")
        for interface in self._interfaces:
            interface.publish(quiet)
