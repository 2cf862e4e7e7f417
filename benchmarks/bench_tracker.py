"""Points per second of the tracker's chain: codec, the bridge's checks, a loopback connection."""

from __future__ import annotations

import time

import numpy as np

from stage_twin.emulators.tracker import TrackerInstrument
from stage_twin.emulators.tracker_server import TrackerServer
from tracker_bridge import tpi
from tracker_bridge.bridge import Bridge
from tracker_bridge.samples import Sample
from tracker_bridge.sources.emscon import EmsconSource
from tracker_bridge.tpi_packets import POINT, MultiMeasurement


def codec_rate(points: int = 200_000, per_packet: int = 10) -> float:
    """Points per second from bytes to arrays."""
    record = np.zeros(per_packet, POINT)
    packet = tpi.encode_multi(MultiMeasurement(0, 1, 0, 20.0, 1013.0, 45.0, record))
    splitter = tpi.StreamSplitter()
    begin = time.perf_counter()
    for _ in range(points // per_packet):
        for whole in splitter.feed(packet):
            tpi.decode(whole)
    return points / (time.perf_counter() - begin)


def check_rate(points: int = 200_000) -> float:
    """Points per second through the bridge's checks."""
    bridge = Bridge(source_clock='ros')
    samples = [Sample((1e-6 * k, 0.0, 0.0), 0, k * 1_000_000) for k in range(points)]
    begin = time.perf_counter()
    for sample in samples:
        bridge.process(sample)
    return points / (time.perf_counter() - begin)


def loopback_rate(points: int = 50_000) -> float:
    """Points per second from the emulated tracker to a source, one point per packet."""
    received: list[Sample] = []
    server = TrackerServer(TrackerInstrument())
    source = EmsconSource(received.append, '127.0.0.1', server.port, 0.001)
    source.start()
    try:
        while not source.connected:
            time.sleep(0.01)
        begin = time.perf_counter()
        for k in range(points):
            server.push(k * 1_000_000, (0.0, 0.0, 0.0))
        server.flush()
        while len(received) < points:
            time.sleep(0.001)
        return points / (time.perf_counter() - begin)
    finally:
        source.stop()
        server.close()


def main() -> None:
    """Print every figure."""
    print(f'TPI codec, 10 points per packet   {codec_rate():12,.0f} points/s')
    print(f'checks of the bridge              {check_rate():12,.0f} points/s')
    print(f'emulated tracker to source        {loopback_rate():12,.0f} points/s')


if __name__ == '__main__':
    main()
