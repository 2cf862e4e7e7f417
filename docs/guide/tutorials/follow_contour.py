# %% [markdown]
# # Notebook: follow a contour
#
# Two axes that lag behind leave the path where they reverse. This tutorial drives a circle on the
# emulated stage, couples the axes through the contour error, and lets the controller learn from
# run to run. You need no hardware and no ROS.
#
# The *contour error* is the distance from the table to the path. The *tracking error* is the
# distance to the point of the path where the table should be now. For a drawing only the first one
# counts.

# %%
import numpy as np

from contour_ctrl import curves, reference
from contour_ctrl.learning import Learner, LearningSettings
from contour_ctrl.rehearsal import Rehearsal
from contour_ctrl.tick import Controller, Gains
from stage_core.twin_file import TwinFile
from stage_reports.figures import contour_polar, convergence

# %% [markdown]
# ## The machine and the path
#
# Friction holds each axis when it reverses, and the x screw has play. The circle has a radius of
# 20 mm and is followed at 50 mm/s.

# %%
real = TwinFile.nominal_servo().with_effects(
    {
        'backlash.x': {'width': 8e-6},
        'coulomb_friction.x': {'coulomb': 6.0, 'presliding': 2e-6},
        'coulomb_friction.y': {'coulomb': 4.0, 'presliding': 2e-6},
    }
)
plan = reference.plan(curves.circle(0.02), feed=0.05)


def contour_error(controller):
    """Distance to the path in each tick of the last run, (n,) [m]."""
    return plan.contour_errors(controller.record[:, :2])


print(f'{len(plan)} ticks of {1e3 * plan.period:g} ms')

# %% [markdown]
# ## Without and with coupling
#
# `cross_coupling` turns the contour error into a velocity of both axes towards the path. With 0
# each axis looks after itself.

# %%
records = {}
for name, gain in (('no coupling', 0.0), ('coupled', 20.0)):
    controller = Controller(plan, Gains(cross_coupling=gain))
    result = Rehearsal(real).run(controller)
    records[name] = contour_error(controller)
    print(f'{name}: {result.sentence()}')

# %% [markdown]
# ## Learn from run to run
#
# What returns in every run can be learned: the learner shifts the error of one run in time,
# filters it, and adds it to the command of the next run.

# %%
controller = Controller(plan, Gains(cross_coupling=20.0))
learner = Learner(len(plan), plan.period, LearningSettings())
results = Rehearsal(real).iterate(controller, learner, 6)
records['sixth run'] = contour_error(controller)
for number, result in enumerate(results, 1):
    print(f'run {number}: contour error {1e6 * result.contour.rms:5.2f} µm RMS')
convergence(
    {
        'contour, RMS': [result.contour.rms for result in results],
        'contour, maximum': [result.contour.max for result in results],
    }
)

# %% [markdown]
# The RMS falls from run to run. The largest error falls more slowly. It stands where an axis
# reverses, and the friction there changes its sign within a few ticks.
#
# ## The error on the circle

# %%
angle = np.arctan2(plan.position[:, 1], plan.position[:, 0])
cruising = slice(200, -200)
contour_polar(
    [(name, angle[cruising], error[cruising]) for name, error in records.items()], radius=0.02
)

# %% [markdown]
# The spikes stand where an axis reverses: at 90° and 270° it is y, at 180° it is x. At 0° the run
# begins and ends, which the picture leaves out. Coupling makes the spikes smaller. Learning takes
# them away except their tips.
#
# ## Next
#
# - `curves` knows more paths, and a path of your own comes as points:
#   [curves to high relative accuracy](paper4.md).
# - [Contour control](../../concepts/contour.md) explains the laws and their settings.
# - `ros2 run stage_bringup up`, then `ros2 service call /contour_ctrl/run std_srvs/srv/Trigger`,
#   follows the circle with the nodes.
