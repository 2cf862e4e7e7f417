# %% [markdown]
# # Notebook: find the missing effect
#
# A simulator and its machine differ, and one would like to know why. This tutorial records a
# session of an emulated machine with two effects that its nominal twin lacks. The diagnosis then
# names them from the recording alone. You need no hardware and no ROS. Most of the minute that it
# runs goes into the diagnosis.

# %%
import numpy as np

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report import figures
from gap_diagnosis.report.document import sentence
from stage_core import topics
from stage_core.clocks import to_stamps
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import TwinFile
from stage_core.wording import effect_words, with_std
from stage_twin.effects import effect_of
from stage_twin.simulate import simulate

# %% [markdown]
# ## The machine and what its owner believes
#
# The effects below are what the diagnosis has to find: play in the x screw, and friction.

# %%
nominal = TwinFile.nominal_servo()
real = nominal.with_effects(
    {
        'backlash.x': {'width': 8e-6},
        'coulomb_friction.x': {'coulomb': 6.0, 'presliding': 2e-6},
    }
)

# %% [markdown]
# ## A session
#
# Both axes make smooth strokes of random length with rests in between, for 20 s. A good session
# reverses often, visits the whole travel, and moves at several speeds.

# %%
generator = np.random.default_rng(0)
period = nominal.control_period
times = np.arange(20_000) * period


def strokes():
    """Positions of one axis, (n,) [m]."""
    path, begin, place = np.zeros(len(times)), 0.3, 0.0
    while begin < times[-1] - 1.5:
        target, length = generator.uniform(-0.03, 0.03), generator.uniform(0.4, 1.2)
        s = np.clip((times - begin) / length, 0.0, 1.0)
        path += (target - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        place, begin = target, begin + length + 0.15
    return path


path = np.column_stack([strokes(), strokes()])
rate = np.gradient(path, period, axis=0)
result = simulate(real, path, rate, seed=1)

# %% [markdown]
# A bag holds these arrays under the topics of the stage. `session_bags.reader.read_session` reads
# one. Here the session is made by hand.

# %%
start = 1_750_000_000_000_000_000  # any moment, in ns
ticks, points = (to_stamps(t, start) for t in (result.times, result.tracker_stamps))
command = {'velocity': result.velocity_command, 'effort': result.force}
state = {'position': result.encoder, 'velocity': result.velocity}
session = Session(
    'tutorial',
    by_topic(
        Series.per_axis(topics.REFERENCE, ticks, position=path, velocity=rate),
        Series.per_axis(topics.COMMAND, ticks, **command),
        Series.per_axis(topics.JOINT_STATES, ticks, **state),
        Series.points(topics.TRACKER_POINT, points, result.tracker_points),
    ),
)

# %% [markdown]
# ## Ask
#
# The diagnosis runs the nominal twin on the same commands. What it cannot predict is the *gap*. It
# then tries every effect of its library on one part of the session and judges it on the other.

# %%
diagnosis = diagnose([session], [], nominal, 'nominal')
print(sentence(diagnosis))
for name in diagnosis.accepted:
    print(effect_words(name))
    units = {parameter.name: parameter.unit for parameter in effect_of(name).parameters}
    for key, (value, deviation) in diagnosis.parameters[name].items():
        print(f'    {key} {with_std(value, deviation, units[key])}')

# %% [markdown]
# Both effects are named, with sizes near those that were put in. Nothing else is: an effect that
# only imitates another one does not shrink the held-out gap any further.
#
# ## See

# %%
figures.time_series(diagnosis)

# %% [markdown]
# Blue is the gap that is left with the effects. It should look like noise: no steps, no slope, no
# spikes that come back at each reversal.

# %%
figures.shares(diagnosis)

# %% [markdown]
# The bars show which conditions the gap depends on. Both play and friction depend on the side from
# which a place is approached.
#
# ## Next
#
# - [How to read a diagnosis](../diagnosis_reading.md) goes through the page that the command
#   writes for a bag.
# - [Your simulator](../simulator.md) asks the same of a MuJoCo model or a URDF.
