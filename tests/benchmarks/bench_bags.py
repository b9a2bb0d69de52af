# SPDX-License-Identifier: Apache-2.0
"""
How fast bags are written, read, recorded and processed here, against `mcap` and `rosbags` in the same run.

    python tests/benchmarks/bench_bags.py [--messages 300000] [--seconds 5] [--hours 1]

Absolute figures belong to the machine; the ratios are what should hold elsewhere.
"""

from __future__ import annotations

import argparse
import csv
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore

from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_sensors.core.frames import mat_nt
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap.recovery import check
from mwd_surface.bags.recorder.recorder import Recorder
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.processing import attitude_csv, process

DIP = 1.1
# The field of the recording below, so that nothing is taken for a disturbance.
FIELD = {
    "place.field": "fixed",
    "place.total_nt": 50_000.0,
    "place.dip_deg": math.degrees(DIP),
    "place.declination_deg": 0.0,
}
IMU, MAG = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
START = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)


def samples(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Imu at 1 kHz and field at 100 Hz, with the noise that decides how well they compress."""
    random = np.random.default_rng(1)
    imu, mag = wire.IMU.empty(count), wire.MAG.empty(count // 10)
    imu["stamp_ns"] = START + np.arange(count) * 1_000_000
    imu["angular_velocity"] = random.normal(size=(count, 3))
    imu["linear_acceleration"] = random.normal(size=(count, 3))
    mag["stamp_ns"] = START + np.arange(count // 10) * 10_000_000
    mag["magnetic_field"] = random.normal(size=(count // 10, 3)) * 5e-5
    return imu, mag


def write_ours(path: Path, imu: np.ndarray, mag: np.ndarray) -> int:
    """Seconds of rows, as the simulator writes them."""
    with BagWriter(path) as writer:
        one, two = writer.topic("/imu/data_raw", IMU), writer.topic("/imu/mag", MAG)
        for k in range(0, len(imu), 1000):
            part, field = imu[k : k + 1000], mag[k // 10 : k // 10 + 100]
            writer.write_rows(one, wire.IMU.encode(part, "sonde_link"), part["stamp_ns"])
            writer.write_rows(two, wire.MAG.encode(field, "sonde_link"), field["stamp_ns"])
    return len(imu) + len(mag)


def write_ours_singly(path: Path, rows: list[bytes], stamps: list[int]) -> int:
    """Message by message."""
    with BagWriter(path) as writer:
        channel = writer.topic("/imu/data_raw", IMU)
        for data, stamp in zip(rows, stamps, strict=True):
            writer.write(channel, data, stamp)
    return len(rows)


def write_mcap(path: Path, rows: list[bytes], stamps: list[int]) -> int:
    """The mcap library."""
    with path.open("wb") as file:
        writer = McapLibraryWriter(file)
        writer.start("ros2")
        channel = writer.register_channel("/imu/data_raw", "cdr", writer.register_schema(IMU, "ros2msg", b""))
        for data, stamp in zip(rows, stamps, strict=True):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return len(rows)


def write_rosbags(path: Path, rows: list[bytes], stamps: list[int]) -> int:
    """The rosbags library, with zstd as well."""
    writer = RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/imu/data_raw", IMU, typestore=STORE)
        for data, stamp in zip(rows, stamps, strict=True):
            writer.write(connection, stamp, data)
    return len(rows)


def read_blocks(path: Path, topics: list[str] | None = None) -> int:
    """Samples as arrays."""
    with Bag(path) as bag:
        return sum(len(stamps) for block in bag.blocks(topics) for stamps, _ in block.values())


def read_messages(path: Path) -> int:
    """Raw messages in order."""
    with Bag(path) as bag:
        return sum(1 for _ in bag.messages())


def read_mcap(path: Path) -> int:
    """The mcap library, raw."""
    with next(path.glob("*.mcap")).open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


def read_rosbags(path: Path) -> int:
    """The rosbags library, raw."""
    with Reader(path) as reader:
        return sum(1 for _ in reader.messages())


def read_rosbags_decoded(path: Path, most: int = 50_000) -> int:
    """The rosbags library, decoded."""
    count = 0
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            STORE.deserialize_cdr(data, connection.msgtype)
            count += 1
            if count == most:
                break
    return count


def best(run: Callable[[int], int], turns: int = 3) -> float:
    """Messages per second of the fastest of a few turns; the first also compiles."""
    rates = []
    for turn in range(turns):
        began = time.perf_counter()
        count = run(turn)
        rates.append(count / (time.perf_counter() - began))
    return max(rates)


def record(folder: Path, seconds: float, rate: int = 2000) -> dict[str, float]:
    """Imu at `rate` and 200 other messages a second in real time: share of a core, and how long a caller is held up."""
    # The reader counts only topics whose messages begin as CDR does.
    cdr, held, taken = b"\0\1\0\0", [], 0
    imu, other = cdr + np.random.default_rng(1).bytes(336), cdr + bytes(116)
    with Recorder(folder, RecorderSettings(min_free_bytes=0)) as recorder:
        path = recorder.start("run")
        began, cpu, put_cpu = time.perf_counter(), time.process_time(), 0.0
        for k in range(int(seconds * 1000)):
            while time.perf_counter() < began + k * 1e-3:
                time.sleep(max(0.0, began + k * 1e-3 - time.perf_counter()))
            now = time.time_ns()
            for n in range(rate // 1000 + (k % 5 == 0)):
                before = time.perf_counter()
                topic = ("/imu/data_raw", IMU, imu) if n < rate // 1000 else ("/imu/mag", MAG, other)
                taken += recorder.put(*topic, now + n)
                held.append(time.perf_counter() - before)
                put_cpu += held[-1]
        wall, used = time.perf_counter() - began, time.process_time() - cpu
        stopping = time.perf_counter()
        recorder.stop()
        stopping = time.perf_counter() - stopping
        dropped = recorder.status().dropped
    with Bag(path) as bag:
        found = sum(topic.count for name, topic in bag.topics.items() if name != "/recorder/events")
    idle = _idle_loop(seconds)
    return {
        "messages": taken,
        "lost": taken - found + dropped,
        "core_percent": 100 * (used - idle) / wall,
        "put_us_p50": 1e6 * float(np.percentile(held, 50)),
        "put_us_p99": 1e6 * float(np.percentile(held, 99)),
        "put_us_max": 1e6 * max(held),
        "stop_s": stopping,
    }


def _idle_loop(seconds: float) -> float:
    # What the pacing loop above costs by itself.
    began, cpu = time.perf_counter(), time.process_time()
    for k in range(int(seconds * 1000)):
        while time.perf_counter() < began + k * 1e-3:
            time.sleep(max(0.0, began + k * 1e-3 - time.perf_counter()))
    return time.process_time() - cpu


def peak_mb(path: Path) -> float:
    """Largest resident memory of a process that reads a bag in blocks, MB, above that of its imports."""
    code = (
        "import sys; from mwd_surface.bags.bag_reader import Bag\n"
        "def peak(): return int(next(x for x in open('/proc/self/status') if 'VmHWM' in x).split()[1]) / 1024\n"
        "before = peak()\n"
        "for block in Bag(sys.argv[1]).blocks(): pass\n"
        "print(peak() - before)"
    )
    return float(subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, check=True).stdout)


def drilled(path: Path, seconds: int) -> None:
    """A bag of 150 s of rotation, 30 s of rest, and so on: IMU at 1 kHz, field at 100 Hz, depth at 1 Hz."""
    random, phase = np.random.default_rng(1), 0.0
    field_n = 5e-5 * np.array([math.cos(DIP), 0.0, math.sin(DIP)])
    with BagWriter(path) as writer:
        one, two = writer.topic("/imu/data_raw", IMU), writer.topic("/imu/mag", MAG)
        three = writer.topic("/rig/state", wire.RIG_STATE.type_name)
        for second in range(0, seconds, 2):
            n = 2000
            times = second + np.arange(n) * 1e-3
            turning = times % 180.0 < 150.0
            rate = np.where(turning, 12.0 + 2.0 * np.sin(1.3 * times), 0.0)
            roll = phase + np.cumsum(rate) * 1e-3
            phase = float(roll[-1])
            mat = mat_nt(0.8 + 0.2 * np.sin(times / 900.0), 1.9 + times / 12000.0, roll)
            imu, mag, rig = wire.IMU.empty(n), wire.MAG.empty(n // 10), wire.RIG_STATE.empty(2)
            imu["stamp_ns"] = START + np.round(times * 1e9).astype(np.int64)
            imu["angular_velocity"] = np.where(turning, 0.1, 1e-3)[:, None] * random.normal(size=(n, 3))
            imu["angular_velocity"][:, 0] += rate
            shake = np.where(turning, 8.0, 5e-3)[:, None] * random.normal(size=(n, 3))
            imu["linear_acceleration"] = np.einsum("kji,j->ki", mat, [0.0, 0.0, -9.81]) + shake
            mag["stamp_ns"] = imu["stamp_ns"][::10] + 3_000_000
            mag["magnetic_field"] = np.einsum("kji,j->ki", mat[::10], field_n) + 5e-8 * random.normal(size=(n // 10, 3))
            rig["stamp_ns"], rig["bit_depth"], rig["valid"] = imu["stamp_ns"][::1000], 1000.0 + second / 100.0, 1
            writer.write_rows(one, wire.IMU.encode(imu, "sonde_link"), imu["stamp_ns"])
            writer.write_rows(two, wire.MAG.encode(mag, "sonde_link"), mag["stamp_ns"])
            writer.write_rows(three, wire.RIG_STATE.encode(rig, "rig_floor"), rig["stamp_ns"])


def estimator(method: str) -> EstimatorSettings:
    """The method, with a field to correct by."""
    return settings.changed(EstimatorSettings(), {"gravity.method": method, **FIELD})


def parts(bag: Path, method: str, scratch: Path) -> dict[str, float]:
    """Microseconds of each part of processing alone, per IMU sample, on the first five minutes."""
    fields = {IMU: ("angular_velocity", "linear_acceleration"), MAG: ("magnetic_field",)}
    end = START + 300 * wire.NANOSECONDS

    def read() -> list[dict[str, np.ndarray]]:
        with Bag(bag) as opened:
            return [{k: v[1] for k, v in block.items()} for block in opened.blocks(None, START, end, fields=fields)]

    blocks = read()

    def run() -> list[Output]:
        pipeline, outputs = Pipeline(estimator(method)), []
        for block in blocks:
            if "/imu/mag" in block:
                pipeline.push_mag(block["/imu/mag"])
            outputs.append(pipeline.push_imu(block["/imu/data_raw"]))
        return outputs

    outputs = run()

    def write() -> None:
        lines = attitude_csv.CsvLines()
        with (scratch / "attitude.csv").open("wb") as file:
            for output in outputs:
                file.write(lines(output.attitude, output.gravity))

    count = sum(len(output.attitude) for output in outputs)
    found = {}
    for name, work in (("read", read), ("estimate", run), ("write", write)):
        times = []
        for _ in range(3):
            began = time.perf_counter()
            work()
            times.append(time.perf_counter() - began)
        found[name] = 1e6 * min(times) / count
    return found


def processed(bag: Path, method: str, scratch: Path, turns: int = 3) -> dict[str, float]:
    """Million IMU samples a second from bag to files, as `mwd process` does it, and its processor time, us a sample."""
    best_wall, best_cpu, rows = math.inf, math.inf, 0
    for _ in range(turns):
        began, cpu = time.perf_counter(), time.process_time()
        with Bag(bag) as opened:
            rows = process.process(opened, scratch / "out", estimator(method)).rows
        best_wall = min(best_wall, time.perf_counter() - began)
        best_cpu = min(best_cpu, time.process_time() - cpu)
    return {
        "rate": rows / best_wall / 1e6,
        "wall_s": best_wall,
        "cpu_us": 1e6 * best_cpu / rows,
        "us": 1e6 * best_wall / rows,
    }


def process_peak_mb(bag: Path, scratch: Path, seconds: float) -> float:
    """Largest resident memory of `mwd process` over the first seconds of a bag, MB."""
    # Not ru_maxrss, which a child inherits from who started it.
    code = (
        "from mwd_surface.cli import main\n"
        "try:\n    main()\nfinally:\n"
        "    print('PEAK', next(line for line in open('/proc/self/status') if 'VmHWM' in line).split()[1])"
    )
    words = ["process", str(bag), "-o", str(scratch / f"peak_{seconds:g}"), "--method", "s3", "--end", str(seconds)]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    return float(done.stdout.split("PEAK")[1]) / 1024


def naive(bag: Path, scratch: Path, most: int = 20_000) -> float:
    """IMU samples a second of what one would write first: rosbags, numpy, the csv module, message by message."""
    count, down, last = 0, np.array([1.0, 0.0, 0.0]), None
    began = time.perf_counter()
    with Reader(bag) as reader, (scratch / "naive.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        for connection, _, data in reader.messages():
            message = STORE.deserialize_cdr(data, connection.msgtype) if connection.msgtype in (IMU, MAG) else None
            if message is None or connection.msgtype == MAG:
                continue
            stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            rate, force = message.angular_velocity, message.linear_acceleration
            w, f = np.array([rate.x, rate.y, rate.z]), np.array([force.x, force.y, force.z])
            if last is not None:
                error = np.cross(-f / np.linalg.norm(f), down)
                down = down - np.cross(w + 0.15 * error, down) * (stamp - last)
                down /= np.linalg.norm(down)
            last = stamp
            inclination = math.atan2(math.hypot(down[1], down[2]), down[0])
            toolface = math.atan2(-down[1], -down[2]) % (2.0 * math.pi)
            writer.writerow([stamp, f"{math.degrees(inclination):.6f}", f"{math.degrees(toolface):.6f}"])
            count += 1
            if count == most:
                break
    return count / (time.perf_counter() - began)


def measure_processing(folder: Path, hours: float) -> None:
    """Print the figures of `mwd process`."""
    bag = folder / "drilled"
    drilled(bag, round(3600 * hours))
    plain, times = naive(bag, folder), []
    for method in ("s3", "bounded"):
        alone = parts(bag, method, folder)
        whole = processed(bag, method, folder)
        total = sum(alone.values())
        each = ", ".join(f"{name} {value:.2f}" for name, value in alone.items())
        print(
            f"process --method {method}: {whole['rate']:.2f} M IMU samples/s, {hours:g} h at 1 kHz in "
            f"{whole['wall_s']:.1f} s; {whole['us']:.2f} us a sample against {total:.2f} of its parts one after "
            f"another ({each}), ratio {whole['us'] / total:.2f}; {whole['cpu_us']:.2f} us of "
            f"processor, {whole['cpu_us'] / whole['us']:.1f} cores busy"
        )
        times.append(f"{method} {1e6 * whole['rate'] / plain:.0f} x")
    print(f"rosbags and a numpy loop, message by message: {plain / 1e3:.1f} k IMU samples/s; {', '.join(times)} that")
    for seconds in (300.0, 3600.0 * hours):
        print(f"mwd process over {seconds:g} s: at most {process_peak_mb(bag, folder, seconds):.0f} MB in memory")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--messages", type=int, default=300_000, help="Imu messages")
    parser.add_argument("--seconds", type=float, default=5.0, help="length of the recorder's run")
    parser.add_argument("--hours", type=float, default=1.0, help="length of the recording that is processed")
    options = parser.parse_args()
    imu, mag = samples(options.messages)
    few = imu[: options.messages // 5]
    rows = [row.tobytes() for row in wire.IMU.encode(few, "sonde_link")]
    stamps = few["stamp_ns"].tolist()
    with tempfile.TemporaryDirectory(prefix="bench_bags_") as scratch:
        folder = Path(scratch)
        rates = {
            "write rows": best(lambda turn: write_ours(folder / f"ours{turn}", imu, mag)),
            "write singly": best(lambda turn: write_ours_singly(folder / f"single{turn}", rows, stamps)),
            "write mcap": best(lambda turn: write_mcap(folder / f"library{turn}.mcap", rows, stamps), 2),
            "write rosbags": best(lambda turn: write_rosbags(folder / f"rosbags{turn}", rows, stamps), 2),
        }
        bag = folder / "ours0"
        rates |= {
            "read blocks": best(lambda _: read_blocks(bag)),
            "read blocks, one topic": best(lambda _: read_blocks(bag, ["/imu/data_raw"])),
            "read messages": best(lambda _: read_messages(bag), 2),
            "read mcap raw": best(lambda _: read_mcap(bag), 1),
            "read rosbags raw": best(lambda _: read_rosbags(bag), 1),
            "read rosbags decoded": best(lambda _: read_rosbags_decoded(bag), 1),
            "check": best(lambda _: check(bag / "ours0_0.mcap").messages, 1),
        }
        size = (bag / "ours0_0.mcap").stat().st_size / (len(imu) + len(mag))
        memory = peak_mb(bag)
        recorder = record(folder / "recordings", options.seconds)
        measure_processing(folder, options.hours)
    for name, rate in rates.items():
        print(f"{name:28s} {rate / 1e3:10.0f} k msg/s")
    ratios = {
        "write rows / mcap": rates["write rows"] / rates["write mcap"],
        "write rows / rosbags": rates["write rows"] / rates["write rosbags"],
        "write singly / mcap": rates["write singly"] / rates["write mcap"],
        "read blocks / rosbags decoded": rates["read blocks"] / rates["read rosbags decoded"],
        "read blocks / rosbags raw": rates["read blocks"] / rates["read rosbags raw"],
        "read blocks / mcap raw": rates["read blocks"] / rates["read mcap raw"],
        "read messages / rosbags raw": rates["read messages"] / rates["read rosbags raw"],
    }
    for name, ratio in ratios.items():
        print(f"{name:32s} {ratio:6.1f} x")
    print(f"bytes per message on disk {size:.0f}; reading took {memory:.0f} MB beyond imports")
    print("recorder at 2 kHz + 200/s: " + ", ".join(f"{name} {value:.3g}" for name, value in recorder.items()))
    print(f"this process at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
