"""Rates of the tracker's chain without ROS, and a fuzz of its parsers.

Prints points per second through the TPI codec, through the bridge's checks and over a loopback
connection, then feeds random frames and datagrams to the parsers and prints what came out.
"""

from __future__ import annotations

import argparse
import random
import resource
import time

import numpy as np

from stage_twin.emulators.tracker import TrackerInstrument
from stage_twin.emulators.tracker_server import TrackerServer
from tracker_bridge import tpi
from tracker_bridge.bridge import Bridge
from tracker_bridge.sa_text import SaTextDecoder, SaTextError
from tracker_bridge.samples import Sample
from tracker_bridge.sources.emscon import EmsconSource
from tracker_bridge.tpi_packets import POINT, MultiMeasurement, TpiError


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


def fuzz(frames: int, seed: int = 1) -> tuple[int, int, int]:
    """Feed random frames; return refused ones, understood ones, and growth of memory [KiB]."""
    source = random.Random(seed)
    refused = understood = 0
    text = SaTextDecoder()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for index in range(frames):
        body = source.randbytes(source.randrange(120))
        try:
            if index % 3 == 0:
                text.decode(body, index)
            elif index % 3 == 1:
                tpi.decode(tpi.HEADER.pack(8 + len(body), source.randrange(12)) + body)
            else:
                for packet in tpi.StreamSplitter().feed(body):
                    tpi.decode(packet)
            understood += 1
        except (TpiError, SaTextError):
            refused += 1
    return refused, understood, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before


def main() -> None:
    """Print every figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--frames', type=int, default=1_000_000, help='random frames to parse')
    frames = parser.parse_args().frames
    print(f'TPI codec, 10 points per packet   {codec_rate():12,.0f} points/s')
    print(f'checks of the bridge              {check_rate():12,.0f} points/s')
    print(f'emulated tracker to source        {loopback_rate():12,.0f} points/s')
    refused, understood, grown = fuzz(frames)
    print(
        f'{frames:,} random frames: {refused:,} refused, {understood:,} understood, '
        f'no other exception, memory grew by {grown} KiB'
    )


if __name__ == '__main__':
    main()
