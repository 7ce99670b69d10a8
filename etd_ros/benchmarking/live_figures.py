"""The live node's figures: latency, what it sustains, what it does above that, what it costs while idle, its start."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking.live_bench import OWN_WINDOW_S, PERCENTILES, LiveBench, rounded_start_ns
from etd_ros.benchmarking.live_load import NS_PER_S, Echo, LoadGenerator, Play
from etd_ros.benchmarking.live_machine import MachineTime
from etd_ros.benchmarking.live_outcome import Outcome, box_latencies
from etd_ros.benchmarking.live_process import NODE
from etd_ros.benchmarking.live_scene import NS_PER_US, LiveScene
from etd_ros.benchmarking.measure import spread_of
from etd_ros.benchmarking.report import Row
from etd_ros.boxes import Box
from etd_ros.settings import STAGES
from etd_ros.warm_up import warm_up

MEV = 1_000_000
DAVIS, VGA, HD = (240, 180), (640, 480), (1280, 720)
BOXES = f"{NODE}/detections"
LATENCY_RATE = 1 * MEV
LATENCY_MESSAGES_PER_S = (100, 250)
MESSAGES_PER_S = 250
SUSTAINED_RATES = tuple(round(rate * MEV) for rate in (1, 2, 3.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 25, 30, 35, 40, 45))
OVERLOAD_RATE = 50 * MEV
RUN_IN_S = 1.0
"""What of a play is not judged: the target's start, and what the node does for the first time."""

RIGHT_IOU, RIGHT_SHARE = 0.5, 0.95
"""Boxes are right where so many of them overlap the truth so far."""

OFFERED_SHARE_MIN = 0.98
"""A generator that gets less of its events out says nothing about the node."""

PLAYS_MAX = 3
"""A rate that the node keeps up with in one of so many plays is sustained: what else the machine does for a moment
fails a play as well as the node does."""

BACKLOG_S = 0.25
"""Boxes that come later than this at the end of a play are those of a node that does not keep up."""

SETTLE_S = 0.2
"""How long after the last message echoes may come."""

NO_BOX = Box(0, 0, 0, 0)
Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LiveEffort:
    """How long to measure.

    Attributes:
        sensors: on which what is sustained and what is too much are measured.
        latency_s, probe_s, overload_s, idle_s: how long each play, or look, lasts.
        rates: of which the highest sustained one is sought (events/s), rising.
        starts: how often the node is started.
        waits: whether the node's own latencies are to be of one play each.
    """

    sensors: tuple[tuple[int, int], ...]
    latency_s: float
    probe_s: float
    overload_s: float
    idle_s: float
    rates: tuple[int, ...]
    starts: int
    waits: bool


FULL_LIVE = LiveEffort((DAVIS, VGA, HD), 5.0, 2.5, 4.0, 3.0, SUSTAINED_RATES, 3, waits=True)
QUICK_LIVE = LiveEffort((DAVIS,), 1.0, 1.5, 2.0, 1.5, (1 * MEV,), 1, waits=False)


def live_figures(bench: LiveBench, effort: LiveEffort) -> Iterator[Row]:
    """All rows, one by one as they are measured.

    Raises:
        BenchmarkError: the node ends, or does not do its work.
    """
    warm_up(tuple(STAGES))
    machine = MachineTime()
    for sensor in effort.sensors:
        with LoadGenerator(*sensor, bench.place) as generator:
            scene = LiveScene(*sensor)
            if sensor == DAVIS:
                yield from _floor(bench, generator, effort)
                yield from _start_and_exit(bench, generator, scene, effort)
            else:
                bench.start_pipeline()
            _attach(bench, generator)
            if sensor == DAVIS:
                yield from _latency(bench, generator, scene, effort)
                yield from _idle(bench, generator, effort)
            yield from _sustained(bench, generator, scene, effort)
            yield from _overload(bench, generator, scene, effort)
            bench.end_pipeline()
    told = "while all this was measured"
    yield Row("other_load", "", 100 * machine.others_share(), "% of the machine", None, None, None, told, None)


def _attach(bench: LiveBench, generator: LoadGenerator) -> None:
    """Read the node's boxes, and wait until events reach it."""
    bench.read(BOXES)
    bench.wait_until(lambda: bench.listens and bench.hears_boxes and bench.reads_events, "the node to read events")
    bench.wait_until(lambda: generator.subscribers() == 1, "the node's subscription")


def _floor(bench: LiveBench, generator: LoadGenerator, effort: LiveEffort) -> Iterator[Row]:
    """What the messages' way to a process and a box's way back take without any work."""
    bench.read(bench.place.echo)
    with Echo(bench.place):
        bench.wait_until(lambda: bench.hears_boxes and generator.subscribers() == 1, "the echo")
        for messages_per_s in LATENCY_MESSAGES_PER_S:
            generator.prepare(LATENCY_RATE, messages_per_s)
            generator.play(Play(rounded_start_ns(time.time_ns()), RUN_IN_S + effort.latency_s))
            bench.wait_until(lambda: generator.is_done, "the play's end")
            bench.listen_for(SETTLE_S)
            yield from _percentiles(
                "latency_floor", messages_per_s, *box_latencies(bench.take_boxes(), generator.played())
            )
    bench.read(None)


def _latency(bench: LiveBench, generator: LoadGenerator, scene: LiveScene, effort: LiveEffort) -> Iterator[Row]:
    for messages_per_s in LATENCY_MESSAGES_PER_S:
        generator.prepare(LATENCY_RATE, messages_per_s)
        if effort.waits:
            # What the node says of itself is to be of this play alone.
            bench.listen_for(OWN_WINDOW_S - RUN_IN_S - effort.latency_s)
        outcome = bench.run(generator, scene, RUN_IN_S + effort.latency_s)
        yield from _percentiles("latency", messages_per_s, outcome.after_s, outcome.latency_ms)
        for percent, value in outcome.own_latency_ms.items():
            yield _figure(f"latency_node_p{percent}", DAVIS, value, "ms", _told(LATENCY_RATE, messages_per_s))
        value = float(np.mean(outcome.iou[outcome.after_s >= RUN_IN_S]))
        yield _figure("latency_iou", DAVIS, value, "IoU", _told(LATENCY_RATE, messages_per_s))


def _percentiles(what: str, messages_per_s: int, after_s: Numbers, latency_ms: Numbers) -> Iterator[Row]:
    """Over all boxes after the run-in; the spread is that of the same percentile of each second."""
    seconds, latency_ms = after_s[after_s >= RUN_IN_S].astype(np.int64), latency_ms[after_s >= RUN_IN_S]
    for percent in PERCENTILES:
        each = [float(np.percentile(latency_ms[seconds == second], percent)) for second in np.unique(seconds)]
        value = float(np.percentile(latency_ms, percent))
        yield _figure(f"{what}_p{percent}", DAVIS, value, "ms", _told(LATENCY_RATE, messages_per_s), _spread(each))


def _idle(bench: LiveBench, generator: LoadGenerator, effort: LiveEffort) -> Iterator[Row]:
    generator.prepare(LATENCY_RATE, MESSAGES_PER_S)
    value = _cpu_percent(bench, effort.idle_s)
    yield _figure("idle_cpu", DAVIS, value, "% of a core", "subscribed, a target, no events")
    bench.start_target(NO_BOX, 0)
    bench.read(None)
    bench.wait_until(lambda: not bench.reads_events, "the node to read events no longer")
    generator.play(Play(rounded_start_ns(time.time_ns()), 2 * effort.idle_s))
    value = _cpu_percent(bench, effort.idle_s)
    generator.stop()
    generator.played()
    yield _figure("idle_cpu", DAVIS, value, "% of a core", f"{_told(LATENCY_RATE, MESSAGES_PER_S)}, nobody subscribed")
    _attach(bench, generator)


def _cpu_percent(bench: LiveBench, duration_s: float) -> float:
    """The node's share of a core while it is left alone."""
    before_s, started_s = bench.process.cpu_s, time.monotonic()
    time.sleep(duration_s)
    return 100 * (bench.process.cpu_s - before_s) / (time.monotonic() - started_s)


def _sustained(bench: LiveBench, generator: LoadGenerator, scene: LiveScene, effort: LiveEffort) -> Iterator[Row]:
    def played(rate: int) -> Outcome:
        generator.prepare(rate, MESSAGES_PER_S)
        return bench.run(generator, scene, effort.probe_s)

    rate, unimaged = highest_sustained(played, effort.rates, effort.probe_s)
    sensor, told = (scene.width, scene.height), f"{MESSAGES_PER_S} msg/s"
    yield _figure("sustained", sensor, rate / MEV, "Mev/s", told)
    yield _figure("sustained_unimaged", sensor, unimaged, "% of events", told)


def highest_sustained(played: Callable[[int], Outcome], rates: Sequence[int], duration_s: float) -> tuple[int, float]:
    """The highest of rising rates (events/s) that the node keeps up with in one of PLAYS_MAX plays, sought by halving,
    and the share of that play's events that were left out of the images (percent); zeros where it is none of them.

    Args:
        played: plays a rate.
        rates: to choose from.
        duration_s: of a play.
    """
    low, high, unimaged = -1, len(rates), 0.0
    while high - low > 1:
        middle = (low + high) // 2
        rate = rates[middle]
        plays = (played(rate) for _ in range(PLAYS_MAX))
        kept_up = next((outcome for outcome in plays if keeps_up(outcome, rate, duration_s)), None)
        if kept_up is None:
            high = middle
        else:
            low, unimaged = middle, kept_up.unimaged
    return (rates[low] if low >= 0 else 0), unimaged


def keeps_up(outcome: Outcome, rate: int, duration_s: float) -> bool:
    """Whether a rate (events/s) was offered, nothing was lost, and boxes were right and came in time to the end."""
    was_offered = _offered(outcome, rate) >= OFFERED_SHARE_MIN * rate
    return was_offered and outcome.is_lossless and _is_right(outcome) and _is_up_to_date(outcome, duration_s)


def _offered(outcome: Outcome, rate: int) -> float:
    """Events per second that the generator reached."""
    return outcome.published * rate / MESSAGES_PER_S / outcome.duration_s


def _is_right(outcome: Outcome) -> bool:
    return bool(len(outcome.iou)) and float(np.mean(outcome.iou >= RIGHT_IOU)) >= RIGHT_SHARE


def _is_up_to_date(outcome: Outcome, duration_s: float) -> bool:
    last = outcome.after_s >= duration_s - BACKLOG_S
    return bool(last.any()) and float(np.median(outcome.latency_ms[last])) < 1e3 * BACKLOG_S


def _overload(bench: LiveBench, generator: LoadGenerator, scene: LiveScene, effort: LiveEffort) -> Iterator[Row]:
    generator.prepare(OVERLOAD_RATE, MESSAGES_PER_S)
    with LoadGenerator(scene.width, scene.height, bench.place) as learning:
        learning.prepare(LATENCY_RATE, MESSAGES_PER_S)
        bench.wait_until(lambda: learning.subscribers() == 1, "the node's subscription")
        outcome = bench.run(generator, scene, RUN_IN_S + effort.overload_s, learning)
    judged = outcome.after_s >= RUN_IN_S
    sensor, told = (scene.width, scene.height), _told(OVERLOAD_RATE, MESSAGES_PER_S)
    yield _figure("overload_offered", sensor, _offered(outcome, OVERLOAD_RATE) / MEV, "Mev/s", told)
    yield _figure("overload_latency_p99", sensor, float(np.percentile(outcome.latency_ms[judged], 99)), "ms", told)
    yield _figure("overload_dropped", sensor, 100 * outcome.dropped / outcome.published, "% of messages", told)
    yield _figure("overload_unimaged", sensor, outcome.unimaged, "% of events", told)
    yield _figure("overload_iou", sensor, float(np.mean(outcome.iou[judged])), "IoU", told)
    yield _figure("overload_growth", sensor, _growth_mib(outcome), "MiB", told)


def _growth_mib(outcome: Outcome) -> float:
    """How much more memory the node has at the end of a play than once its queue is full."""
    parts = np.array_split(outcome.resident_mib, 4)
    return float(parts[-1].max() - parts[1].max())


def _start_and_exit(bench: LiveBench, generator: LoadGenerator, scene: LiveScene, effort: LiveEffort) -> Iterator[Row]:
    """From the start of the process to where it takes targets and to the first box, and from SIGINT to its end, while
    events come. A process that is not measured stays."""
    generator.prepare(LATENCY_RATE, MESSAGES_PER_S)
    start_ns = rounded_start_ns(time.time_ns())
    generator.play(Play(start_ns, 60.0 * effort.starts))
    bench.read(BOXES)
    ready_s: list[float] = []
    times_s: list[float] = []
    exits_s: list[float] = []
    for _ in range(effort.starts):
        bench.start_pipeline()
        bench.wait_until(lambda: bench.listens, "the node to take targets")
        ready_s.append((time.monotonic_ns() - bench.process.started_ns) / NS_PER_S)
        now_ns = time.time_ns()
        bench.start_target(scene.box((now_ns - start_ns) / NS_PER_US), now_ns)
        times_s.append((bench.first_box_ns() - bench.process.started_ns) / NS_PER_S)
        told_s = time.monotonic()
        bench.end_pipeline()
        exits_s.append(time.monotonic() - told_s)
        bench.wait_until(lambda: not bench.listens, "the node to be gone")
    generator.stop()
    generator.played()
    bench.start_pipeline()
    told = _told(LATENCY_RATE, MESSAGES_PER_S)
    yield _figure("start_to_ready", DAVIS, float(np.median(ready_s)), "s", told, _spread(ready_s))
    yield _figure("start_to_box", DAVIS, float(np.median(times_s)), "s", told, _spread(times_s))
    yield _figure("exit", DAVIS, max(exits_s), "s", told, None)


def _told(rate: float, messages_per_s: int) -> str:
    return f"{rate / MEV:g} Mev/s, {messages_per_s} msg/s"


def _spread(values: Sequence[float]) -> float | None:
    """Interquartile range over median; None of a single value."""
    return spread_of(values) if len(values) > 1 else None


def _figure(
    what: str, sensor: tuple[int, int], value: float, unit: str, stream: str, spread: float | None = None
) -> Row:
    return Row(what, f"{sensor[0]}x{sensor[1]}", value, unit, None, None, None, stream, spread)
