# %% [markdown]
# # Notebook: bring your own tracker
#
# Your instrument measures points and sends them in a form that this software does not know. This
# tutorial writes the two parts that are missing, a decoder and a source, and tries them against an
# emulated instrument on this machine. You need no hardware and no ROS. It runs in a few seconds.
#
# The instrument here sends lines over TCP: milliseconds of its own clock, and x, y, z in inches.
#
#     1024.0;12.5013;-3.2098;0.0001

# %%
import socket
import threading
import time

import numpy as np

from stage_bringup.plan import alignment_points, heldout_points
from stage_core.errors import StageError
from stage_core.frames import RigidTransform
from stage_reports.figures import error_map
from tracker_bridge.bridge import Bridge, Limits
from tracker_bridge.registration import register
from tracker_bridge.samples import Sample
from tracker_bridge.sources.base import Source

# %% [markdown]
# ## The decoder
#
# The decoder turns bytes into a `Sample`: the point in metres, when it arrived, and when it was
# measured on the instrument's own clock. It knows no socket and no clock, so that it can be tested
# with a line of text. What it cannot read it refuses with a sentence that says what to do.

# %%
INCH = 0.0254


def decode(line, receive_ns):
    """Sample of one line."""
    try:
        milliseconds, *inches = (float(word) for word in line.decode().split(';'))
        x, y, z = (INCH * value for value in inches)
    except ValueError as error:
        raise StageError(f'{line!r} holds no point: set the output to t;x;y;z') from error
    return Sample((x, y, z), receive_ns, round(milliseconds * 1e6))


print(decode(b'1024.0;12.5013;-3.2098;0.0001', receive_ns=0))

# %% [markdown]
# ## The source
#
# The source is a thread that connects, delivers samples until `stop`, and says what is wrong and
# how to mend it. Duplicates, late points and the offset of the clocks are not its business: the
# bridge has them.


# %%
class LineSource(Source):
    """Points of an instrument that sends lines over TCP."""

    def __init__(self, deliver, host, port):
        super().__init__(deliver)
        self.address = (host, port)

    def run(self):
        """Read lines until `stop`, connecting again where the line breaks."""
        while not self.ended.is_set():
            try:
                with socket.create_connection(self.address, timeout=1.0) as wire:
                    self.read(wire.makefile('rb'))
            except OSError as error:
                self.connected, self.trouble = False, f'no instrument ({error}): check the cable'
                self.ended.wait(0.2)

    def read(self, lines):
        """Deliver the points of one connection."""
        self.connected, self.trouble = True, ''
        for line in lines:
            if self.ended.is_set():
                return
            try:
                self.deliver(decode(line, time.time_ns()))
            except StageError as error:
                self.count('refused')
                self.trouble = str(error)


# %% [markdown]
# ## An instrument to try it with
#
# The emulated instrument stands turned and shifted beside the stage. It sees the stage rest at
# places of the alignment and then at others. Every place is sent twenty times, with a noise of
# 1 µm. One line is damaged, and one comes twice.

# %%
generator = np.random.default_rng(0)
angle = 0.4
turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
stands = RigidTransform(turn, np.array([0.5, -0.2, 0.1]))
places = np.vstack([alignment_points(0.03), heldout_points(0.03, 20, seed=1)])
rests = np.column_stack([places, np.zeros(len(places))])
repeats = 20


def lines():
    """What the instrument sends."""
    for number, rest in enumerate(np.repeat(rests, repeats, axis=0)):
        seen = (stands.apply(rest) + generator.normal(0.0, 1e-6, 3)) / INCH
        text = ';'.join(f'{value:.7f}' for value in (10.0 * number, *seen))
        yield 'error 17\n' if number == 33 else text + '\n'
        if number == 50:
            yield text + '\n'


server = socket.create_server(('127.0.0.1', 0))


def serve():
    """Send everything to the first who connects."""
    wire, _ = server.accept()
    with wire:
        wire.sendall(''.join(lines()).encode())


threading.Thread(target=serve, daemon=True).start()

# %% [markdown]
# ## Try it
#
# The bridge checks the samples and stamps them with ROS time. The instrument's clock has an
# unknown offset, which the bridge takes from the least delayed point of the first two seconds.
# Here all lines come at once, so that the tutorial takes no time, and the offset is given.

# %%
bridge = Bridge(Limits(rate=100.0, jump=0.1), source_clock='ros')
published = []
source = LineSource(lambda sample: published.extend(bridge.process(sample)), *server.getsockname())
source.start()
expected = len(rests) * repeats - 1
while len(published) < expected:
    time.sleep(0.01)
source.stop()
server.close()
counters = bridge.counters
print(f'{counters.published} points, {counters.duplicates} duplicate', end=', ')
print(f'{source.counters["refused"]} refused')
print('complaints of the bridge:', bridge.complaints() or 'none')

# %% [markdown]
# ## Align it
#
# The first six places align the instrument's frame with that of the stage. The others show what
# the alignment is worth.

# %%
stamps, points = zip(*published, strict=True)
numbers = np.rint(np.array(stamps) / 1e7).astype(int) // repeats
seen = np.array([np.mean(np.array(points)[numbers == k], axis=0) for k in range(len(rests))])
alignment = register(seen[:6], rests[:6])
print(alignment.summary())
left = alignment.transform.apply(seen[6:]) - rests[6:]
print(f'at {len(left)} other places: {1e6 * np.sqrt(np.mean(left[:, :2] ** 2)):.2f} µm RMS')
error_map(places[6:], left[:, :2])

# %% [markdown]
# The arrows point anywhere: the noise of twenty points is left, and no turn and no scale. A wrong
# inch would show as arrows that grow with the distance from the centre.
#
# ## Next
#
# [Adding a tracker](../adding.md#a-tracker) says where decoder and source go, and how the node's
# parameter `source` learns their name.
