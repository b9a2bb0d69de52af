# SPDX-License-Identifier: Apache-2.0
"""
Health of the tool from its log samples: battery, run time, exposure to temperature and vibration, self-tests, parts.

The dose of an exposure is a sum over all levels: the time at a level divided by the time that the tool can withstand
this level. At a dose of 1 the life of the tool is used up (M. A. Miner, Cumulative Damage in Fatigue, J. Appl. Mech.
12, 1945). Time without a sample is not in the dose, so the observed time is given, too.

The charge comes from the counter of the tool. Without a counter it is computed from the duty: the times with the pumps
on and off, and the currents in the tool file. Each charge is divided by the capacity that the battery has at the
temperature at which the charge was drawn; the sum of these shares is the used share.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from mwd_sensors.core.wire import NANOSECONDS, SELF_TESTS
from mwd_sensors.telemetry.log_channels import BATTERY_VOLTAGE, SOURCES, LogSample
from mwd_sensors.telemetry.tool_limits import EXPOSURES, BatteryLimits, ExposureLimit, ToolLimits, ToolPart

_HOUR_S = 3600.0
# Longest gap between two samples that counts as exposure at the later value, s. A link sends its words in turn, so gaps
# are normal. The gap for temperature may be longer, because a tool warms slowly.
_HELD_S, _HELD_TEMPERATURE_S = 120.0, 1800.0
# If a sample is older than the end of its series by more than this, ns, a clock was set back or an earlier stamp was
# wrong: the series begins again at the sample. A step forward by more than this does not count as run time. No link
# delivers a sample later than this; `DepthLog` uses the same rule with a shorter time.
_JUMP_NS = 3600 * NANOSECONDS
_FLOW_HELD_S = 60.0  # longest gap between two rig messages over which the pumps are known not to change, s
# In a gap above _FLOW_HELD_S the charge is assumed: during the first _SILENCE_HELD_S, s, the charge for the last known
# state of the pumps, then the charge for idle pumps. A gap above _LONGEST_SILENCE_S, s, means a wrong clock.
_SILENCE_HELD_S, _LONGEST_SILENCE_S = 3600.0, 30 * 86400.0
_LEAST_COUNTED_S = 600.0  # shortest time over which the charge must be known to compute the mean current, s
# Battery of a usual kit, used if the tool file states none; relative 1 sigma of its capacity and of its currents.
_ASSUMED = BatteryLimits(capacity_sigma=0.25, current_sigma=0.4)
_ROOM_C = 25.0  # room temperature, degC
_MOST_SOURCES, _MOST_BINS = 64, 100  # largest number of sources; largest index of a histogram bin, on each side of 0


@dataclasses.dataclass(frozen=True)
class BatteryHealth:
    """Battery of the tool. Unknown numbers are NaN."""

    #: `voltage`, `sigma_voltage`: newest voltage and its 1 sigma, V
    voltage: float
    sigma_voltage: float
    #: `used`, `sigma_used`: used charge and its 1 sigma, C
    used: float
    sigma_used: float
    capacity: float  #: capacity of the full battery at the newest temperature, C
    current: float  #: mean current from which the remaining time is computed, A
    #: `remaining`, `sigma_remaining`: time until the battery is empty at this temperature and mean current, and its 1
    #: sigma, s
    remaining: float
    sigma_remaining: float
    #: `remaining_active`, `remaining_idle`: remaining time with the pumps always on, and always off, s
    remaining_active: float
    remaining_idle: float
    #: sentences on assumptions; empty if the remaining time follows from the tool file and from measurements
    assumed: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Exposure:
    """Exposure of the tool to one quantity."""

    #: `source`, `unit`: name of the quantity, and unit of all its levels
    source: str
    unit: str
    #: `newest`, `largest`: newest and largest sample
    newest: float
    largest: float
    observed: float  #: time for which there are samples, s
    #: histogram: lower edge of each filled bin, increasing, and time in the bin, s
    bins: tuple[tuple[float, float], ...]
    width: float  #: width of a bin
    dose: float  #: share of the life that is used; 1 is the limit
    limit: float  #: lowest level that uses up life; the tool withstands lower levels without limit
    assumed: bool  #: whether the limit is the usual one of such a kit, because the tool file states none


@dataclasses.dataclass(frozen=True)
class PartHealth:
    """A part of the tool: serial number, day of calibration (empty: none), days by which calibration is overdue."""

    name: str
    serial_number: str
    calibrated: str
    overdue_days: int


@dataclasses.dataclass(frozen=True)
class ToolHealth:
    """Health of the tool."""

    stamp_ns: int = 0  #: end of the newest sample; 0 before the first
    #: run time of the electronics, s: from the tool's counter, else the time since the first sample without gaps of
    #: more than an hour; NaN before the first sample
    run_time: float = math.nan
    pumping: float = math.nan  #: time with the pumps on, s; NaN if the rig has not reported the state of the pumps
    battery: BatteryHealth | None = None  #: None if neither the samples nor the tool file have data on a battery
    exposures: tuple[Exposure, ...] = ()
    #: names of the self-tests that failed when they last ran; None: the tool has reported no results
    failed_tests: tuple[str, ...] | None = None
    #: names of the self-tests that the tool has not reported as run, so that their result is unknown
    unreported_tests: tuple[str, ...] = tuple(SELF_TESTS.values())
    parts: tuple[PartHealth, ...] = ()
    remarks: tuple[str, ...] = ()  #: sentences on data that could not be read


_SUMS_OF_SERIES = {"end_ns": int, "newest_ns": int} | dict.fromkeys(
    ("newest", "sigma", "largest", "dose", "seconds", "running", "width"), float
)


class _Series:
    """History of one quantity: the newest sample, and the time for which the quantity was at each level."""

    def __init__(self, unit: str, limit: ExposureLimit | None) -> None:
        self.unit, self._limit = unit, limit
        self.width = 1.0 if limit is None else _bin_width(limit.hours[0][0])
        self.end_ns = self.newest_ns = -(2**63)
        self.newest = self.sigma = math.nan
        self.largest = -math.inf
        self.dose = self.seconds = self.running = 0.0
        self.bins: Counter[int] = Counter()

    def sums(self) -> dict[str, Any]:
        """Return the sums and the histogram of the quantity, for `restore`."""
        return {name: getattr(self, name) for name in _SUMS_OF_SERIES} | {"bins": sorted(self.bins.items())}

    def restore(self, sums: Mapping[str, Any]) -> None:
        """Replace the sums by sums of an earlier run of the surface, whose bins may have another width."""
        for name, kind in _SUMS_OF_SERIES.items():
            if name != "width":
                setattr(self, name, kind(sums[name]))
        scale = float(sums["width"]) / self.width
        for index, seconds in sums["bins"]:
            self._add_to_bin(math.floor((index + 0.5) * scale) if scale != 1.0 else int(index), float(seconds))

    def _add_to_bin(self, index: int, seconds: float) -> None:
        self.bins[min(max(index, -_MOST_BINS), _MOST_BINS)] += seconds  # type: ignore[assignment]

    def add(self, sample: LogSample, held_s: float) -> None:
        """Add a sample; it represents the time since the previous sample if this time is at most `held_s`, s."""
        half = round(0.5 * sample.span * NANOSECONDS)
        begin, end = sample.stamp_ns - half, sample.stamp_ns + half
        if end < self.end_ns - _JUMP_NS:
            self.end_ns = self.newest_ns = begin - 1
        if sample.stamp_ns > self.newest_ns:
            self.newest, self.sigma, self.newest_ns = sample.value, sample.sigma, sample.stamp_ns
        # Without a recent previous sample, a sample represents its own interval only.
        near = 0 < begin - self.end_ns <= held_s * NANOSECONDS
        seconds = max(0.0, (end - (self.end_ns if near else max(begin, self.end_ns))) / NANOSECONDS)
        known = begin - self.end_ns <= _JUMP_NS
        self.running += max(0, end - (self.end_ns if known else begin)) / NANOSECONDS
        self.end_ns = max(self.end_ns, end)
        self.largest = max(self.largest, sample.value)
        if self._limit is not None and seconds:
            self.seconds += seconds
            self.dose += seconds / (_HOUR_S * self._limit.allowed_h(sample.value))
            self._add_to_bin(math.floor(sample.value / self.width), seconds)


class HealthLedger:
    """
    Account of the health of one tool: sums over its samples.

    Parameters
    ----------
    limits : ToolLimits, optional
        Section `health` of the tool file; None: there is no file.
    """

    def __init__(self, limits: ToolLimits | None = None) -> None:
        self._limits = limits or ToolLimits()
        self._limited = dict(self._limits.exposures or EXPOSURES)
        #: Capacity, currents and sigmas from the tool file, else those of a usual kit.
        self.battery = self._limits.battery or _ASSUMED
        self._series: dict[str, _Series] = {}
        self.version = 0  #: number that increases with every sample in the account
        self._last_ns = 0
        self._flow: tuple[int, bool] | None = None
        self._pumping_s = 0.0
        self._silence = _Silence()
        self._by_duty = _Charge(self.battery)
        self._counted = _Charge(self.battery)
        self._count: tuple[int, float] | None = None

    def add(self, sample: LogSample) -> None:
        """
        Add a sample, in order of arrival.

        A sample is ignored if its value is not finite, if its unit differs from the unit of its source (in `SOURCES`,
        else of the source's first sample), or if its source is new and `_MOST_SOURCES` sources are known already.
        """
        source = sample.source or sample.channel
        if not math.isfinite(sample.value) or (source not in self._series and len(self._series) >= _MOST_SOURCES):
            return
        if source in SOURCES and sample.unit != SOURCES[source].unit:
            return
        if source not in self._series:
            self._series[source] = _Series(sample.unit, self._limited.get(source))
        series = self._series[source]
        if sample.unit != series.unit:
            return
        series.add(sample, _HELD_TEMPERATURE_S if source == "temperature" else _HELD_S)
        self.version += 1
        back = series.end_ns < self._last_ns - _JUMP_NS
        self._last_ns = series.end_ns if back else max(self._last_ns, series.end_ns)
        if source == "consumed_charge":
            self._count_charge(sample)

    def sums(self) -> dict[str, Any]:
        """Return the whole account as numbers, strings, lists and dictionaries, for `restore`."""
        return {
            "last_ns": self._last_ns,
            "flow": self._flow,
            "pumping_s": self._pumping_s,
            "count": self._count,
            "silence": dataclasses.astuple(self._silence),
            "by_duty": self._by_duty.sums(),
            "counted": self._counted.sums(),
            "series": {name: {"unit": one.unit} | one.sums() for name, one in self._series.items()},
        }

    def restore(self, sums: Mapping[str, Any]) -> None:
        """
        Replace the account by the sums of an earlier run of the surface.

        Raises
        ------
        KeyError, TypeError, ValueError
            The sums are not valid; the account is unchanged.
        """
        series = {}
        for name, kept in list(sums["series"].items())[:_MOST_SOURCES]:
            series[name] = _Series(str(kept["unit"]), self._limited.get(name))
            series[name].restore(kept)
        charges = [_Charge(self.battery, [float(x) for x in sums[name]]) for name in ("by_duty", "counted")]
        seconds, active_s, last = sums["silence"]
        silence = _Silence(float(seconds), float(active_s), (float(last[0]), float(last[1])))
        count, flow = sums["count"], sums["flow"]
        count = None if count is None else (int(count[0]), float(count[1]))
        flow = None if flow is None else (int(flow[0]), bool(flow[1]))
        pumping_s, last_ns = float(sums["pumping_s"]), int(sums["last_ns"])
        self._series, (self._by_duty, self._counted), self._silence = series, charges, silence
        self._count, self._flow, self._pumping_s, self._last_ns = count, flow, pumping_s, last_ns
        self.version += 1

    def _count_charge(self, sample: LogSample) -> None:
        if self._count is None:
            # The counter starts with the charge used before the run, at temperatures that are not known.
            self._counted.use(sample.value, 0.0, _ROOM_C)
        else:
            step_ns = sample.stamp_ns - self._count[0]
            if -_JUMP_NS <= step_ns <= 0:
                return
            # Across a jump of the clock the charge is known, and its time is not.
            seconds = step_ns / NANOSECONDS if 0 < step_ns <= _JUMP_NS else 0.0
            if sample.value >= self._count[1]:
                self._counted.use(sample.value - self._count[1], seconds, self._temperature)
            else:
                # The counter starts with a new battery, so a smaller value means that the battery was replaced. Keep
                # the charge and time of the run: the mean current of the tool does not depend on the battery.
                before, self._counted = self._counted, _Charge(self.battery)
                self._counted.use(sample.value, 0.0, _ROOM_C)
                self._counted.in_run, self._counted.seconds = before.in_run, before.seconds
        self._count = (sample.stamp_ns, sample.value)

    def add_flow(self, stamp_ns: int, *, pumping: bool) -> None:
        """
        Add the state of the pumps in order of time; a stamp that is not later than the last one is ignored.

        A stamp that is more than an hour earlier means that a clock was set back: time is counted from it on.
        """
        if self._flow is not None and self._flow[0] - _JUMP_NS <= stamp_ns <= self._flow[0]:
            return
        if self._flow is not None:
            seconds, on = (stamp_ns - self._flow[0]) / NANOSECONDS, self._flow[1]
            if seconds < 0.0:
                self._silence = self._silence.back(-seconds)
            elif seconds <= _FLOW_HELD_S:
                self._pumping_s += seconds if on else 0.0
                current = self.battery.active_a if on else self.battery.idle_a
                self._by_duty.use(current * seconds, seconds, self._temperature)
            elif seconds <= _LONGEST_SILENCE_S:
                self._silence = self._silence.after(seconds, active_s=min(seconds, _SILENCE_HELD_S) if on else 0.0)
        self._flow = (stamp_ns, pumping)

    @property
    def _temperature(self) -> float:
        """Newest temperature, degC; room temperature if unknown."""
        series = self._series.get("temperature")
        return _ROOM_C if series is None else series.newest

    def health(self, day: datetime.date | None = None) -> ToolHealth:
        """Return the health of the tool; day: date of the check of calibrations, by default that of the last sample."""
        # The longest run time of all sources counts, so that a wrong clock of one source does not shorten it.
        since = max((series.running for series in self._series.values()), default=math.nan)
        if day is None and self._last_ns:
            day = datetime.datetime.fromtimestamp(self._last_ns / NANOSECONDS, datetime.UTC).date()
        counter = self._series.get("run_time")
        ran, failed = self._tests("self_tests"), self._tests("failed_self_tests")
        return ToolHealth(
            stamp_ns=self._last_ns,
            run_time=since if counter is None else counter.newest,
            pumping=math.nan if self._flow is None else self._pumping_s,
            battery=self._battery_health(since),
            exposures=tuple(self._exposure(name) for name in self._limited if name in self._series),
            failed_tests=failed,
            unreported_tests=tuple(
                name
                for name in SELF_TESTS.values()
                if failed is None or (name not in failed and name not in (ran or ()))
            ),
            parts=tuple(_part(name, part, day) for name, part in self._limits.parts.items()),
        )

    def _tests(self, source: str) -> tuple[str, ...] | None:
        """Return the names of the self-tests in the newest sample of a source; None if the source has no sample."""
        series = self._series.get(source)
        return None if series is None else tuple(name for bit, name in SELF_TESTS.items() if int(series.newest) & bit)

    def _exposure(self, name: str) -> Exposure:
        series = self._series[name]
        return Exposure(
            source=name,
            unit=series.unit,
            newest=series.newest,
            largest=series.largest,
            observed=series.seconds,
            bins=tuple((index * series.width, float(seconds)) for index, seconds in sorted(series.bins.items())),
            width=series.width,
            dose=series.dose,
            limit=self._limited[name].hours[0][0],
            assumed=not self._limits.exposures,
        )

    def _battery_health(self, since_s: float) -> BatteryHealth | None:
        voltage = self._series.get(BATTERY_VOLTAGE)
        if voltage is None and self._count is None and self._limits.battery is None:
            return None
        item, assumed = self.battery, []
        if self._limits.battery is None:
            assumed.append("the tool file states no battery, so a usual capacity and usual currents are used")
        temperature = self._temperature
        share = item.share(temperature)
        spread = 0.0
        if "temperature" not in self._series:
            assumed.append(f"the temperature is not known, so {_ROOM_C:.0f} degC is used")
            shares = [row[1] for row in item.by_temperature]
            spread = (max(shares) - min(shares)) / math.sqrt(12.0)
        charge, scale = self._counted, item.counter_sigma
        if self._count is None:
            charge, scale = self._by_duty, item.current_sigma
            if self._flow is None:
                assumed.append(
                    "neither the charge nor the flow is known, so the pumps count as on since the first sample"
                )
                charge = _Charge(item)
                charge.use(item.active_a * (0.0 if math.isnan(since_s) else since_s), since_s, temperature)
            silent = self._silence
            if silent.seconds:
                assumed.append(
                    f"the rig sent no flow data for {silent.seconds / _HOUR_S:.1f} h, of which"
                    f" {silent.active_s / _HOUR_S:.1f} h count as pumps on"
                )
            idle_s = silent.seconds - silent.active_s
            charge = charge.after(item.used_ah * _HOUR_S)
            charge.use(item.active_a * silent.active_s + item.idle_a * idle_s, 0.0, temperature)
            assumed.append("the tool does not count its charge, so its charge is estimated from the currents")
        full = item.capacity_ah * _HOUR_S
        known = charge.seconds >= _LEAST_COUNTED_S
        current = charge.in_run / charge.seconds if known else item.active_a
        if not known:
            assumed.append("the run is short, so the pumps count as always on")
        left = max(0.0, full * share * (1.0 - charge.used))
        sigma_used = scale * charge.total
        # The charge left is the capacity minus the used charge, so the error of the whole capacity counts.
        sigma_left = math.hypot(
            full * item.capacity_sigma * share, sigma_used * share, full * (1.0 - charge.used) * spread
        )
        return BatteryHealth(
            voltage=math.nan if voltage is None else voltage.newest,
            sigma_voltage=math.nan if voltage is None else voltage.sigma,
            used=charge.total,
            sigma_used=sigma_used,
            capacity=full * share,
            current=current,
            remaining=_ratio(left, current),
            sigma_remaining=math.hypot(_ratio(sigma_left, current), _ratio(left, current) * item.current_sigma),
            remaining_active=_ratio(left, item.active_a),
            remaining_idle=_ratio(left, item.idle_a),
            assumed=tuple(assumed),
        )


@dataclasses.dataclass(frozen=True)
class _Silence:
    """Silences: times without a known state of the pumps."""

    seconds: float = 0.0  #: total length, s
    active_s: float = 0.0  #: part of the total in which the pumps are assumed to be on
    last: tuple[float, float] = (0.0, 0.0)  #: length and part with pumps on of the last silence alone

    def after(self, seconds: float, active_s: float) -> _Silence:
        """Return the sums with one more silence; seconds, active_s: its length and its part with the pumps on, s."""
        return _Silence(self.seconds + seconds, self.active_s + active_s, (seconds, active_s))

    def back(self, seconds: float) -> _Silence:
        """
        Return the sums after the clock went back by a time, s.

        If the time is at least half of the last silence, a wrong stamp caused the silence, and it is removed.
        """
        if not 0.0 < self.last[0] <= 2.0 * seconds:
            return self
        return _Silence(self.seconds - self.last[0], self.active_s - self.last[1])


class _Charge:
    """
    Charge drawn from a battery.

    total: sum, C. used: used share of the capacity. in_run, seconds: charge drawn during the run, C, and its time, s.
    """

    def __init__(self, battery: BatteryLimits, sums: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> None:
        self._battery = battery
        self.total, self.used, self.in_run, self.seconds = sums

    def sums(self) -> tuple[float, ...]:
        """Return the four numbers of the object: total, used, in_run and seconds."""
        return self.total, self.used, self.in_run, self.seconds

    def use(self, charge: float, seconds: float, celsius: float) -> None:
        """Add a charge, C, drawn in a time, s, at a temperature, degC; 0 s: before the run, or the time is unknown."""
        self.total += charge
        self.used += charge / (self._battery.capacity_ah * _HOUR_S * self._battery.share(celsius))
        if seconds > 0.0:
            self.in_run += charge
            self.seconds += seconds

    def after(self, before: float) -> _Charge:
        """Return a copy to which a charge that was drawn before the run, C, is added."""
        made = _Charge(self._battery)
        made.use(before, 0.0, _ROOM_C)
        made.total, made.used = made.total + self.total, made.used + self.used
        made.in_run, made.seconds = self.in_run, self.seconds
        return made


def _ratio(charge: float, current: float) -> float:
    return charge / current if current > 0.0 else math.nan


def _part(name: str, part: ToolPart, day: datetime.date | None) -> PartHealth:
    return PartHealth(name, part.serial_number, part.calibrated, 0 if day is None else part.overdue_days(day))


def _bin_width(level: float) -> float:
    """Return a round width of the bins of a histogram: about a tenth of the first level of a limit."""
    wanted = max(abs(level), 1e-9) / 10.0
    exponent = math.floor(math.log10(wanted))
    return float(next(k * 10.0**exponent for k in (1, 2, 5, 10) if k * 10.0**exponent >= 0.8 * wanted))
