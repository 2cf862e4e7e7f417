# %% [markdown]
# # Notebook: calibrate a stage
#
# The screws of a stage are not perfect, so the table rests a few micrometres beside the place that
# was asked for. This tutorial measures that error of an emulated stage at a grid of positions,
# fits models of it, and corrects the stage with the best one. You need no hardware and no ROS. It
# runs in seconds.
#
# On a real stage a laser tracker measures the table. [A real stage and a real
# tracker](../real_machine.md) does the same steps with the nodes.

# %%
import numpy as np

from calibrator.models import make_model
from stage_bringup.plan import calibration_grid, heldout_points
from stage_core.twin_file import TwinFile
from stage_reports.figures import error_map, histogram
from stage_twin.kinematics import carry

# %% [markdown]
# ## The machine
#
# The nominal twin is the machine as its owner believes it to be. The real one differs: its x screw
# has play, the axes are not square, and the y screw has an error that returns with every turn. The
# tracker's noise is 0.5 µm.

# %%
nominal = TwinFile.nominal_servo()
real = nominal.with_effects(
    {
        'backlash.x': {'width': 8e-6},
        'nonorthogonality': {'angle': 300e-6},
        'cyclic_pitch_error.y': {'amplitude': 3e-6, 'phase': 0.7},
    }
)
generator = np.random.default_rng(0)
start = np.full((1, 2), -0.031)  # m, where every visit begins


def measured(commands):
    """Where the tracker sees the table at each commanded position, (n, 2) [m]."""
    table = carry(real, np.vstack([start, commands]))[1:]
    return table + generator.normal(0.0, 0.5e-6, commands.shape)


def directions(commands):
    """From which side each position is approached: -1 or +1 for each axis."""
    return np.sign(np.diff(commands, axis=0, prepend=start))


# %% [markdown]
# ## Measure
#
# The grid is visited twice, so that every position is approached from both sides. Play shows only
# that way. Thirty random positions are held out: no model sees them in training.

# %%
grid = calibration_grid(0.03, 9)
held = heldout_points(0.03, 30, seed=1)
at_grid, at_held = measured(grid), measured(held)
print(f'{len(grid)} positions of the grid, {len(held)} held out')
error_map(held, at_held - held)

# %% [markdown]
# The arrows along x grow with y: the axes are not square. What else is in them the eye cannot see.
#
# ## Fit
#
# Each model learns *measured - command*. `identity` learns nothing: it is the stage as it is.

# %%
left = {}
for method in ('identity', 'affine', 'polynomial', 'structured'):
    model = make_model(method).fit(grid, at_grid, directions(grid))
    left[method] = at_held - model.predict(held, directions(held), warn=False)
    print(f'{method:12s} {1e6 * np.sqrt(np.mean(left[method] ** 2)):6.2f} µm RMS held out')
histogram({name: left[name] for name in ('affine', 'structured')})

# %% [markdown]
# `affine` removes the missing squareness and keeps the play. A polynomial of higher order helps no
# further. `structured` also has terms for play and for the turn of the screw, and comes down to
# the noise of the tracker. Below that noise there is nothing to learn.
#
# ## Correct
#
# The model says where a command leads. The stage needs the opposite: the command that leads to the
# wanted place. `invert` computes it.

# %%
model = make_model('structured').fit(grid, at_grid, directions(grid))
corrected = model.invert(held, directions(held))
after = measured(corrected) - held
before = at_held - held
for name, error in (('before', before), ('after', after)):
    print(f'{name:6s} {1e6 * np.sqrt(np.mean(error**2)):6.2f} µm RMS')
error_map(held, before, after)

# %% [markdown]
# Both maps have one scale. After the correction the arrows point anywhere: what is left is noise.
#
# ## Next
#
# - `make_model` knows more methods: [calibration](../../concepts/calibration.md) compares them.
# - `model.to_dict()` is the model as JSON, which the calibrator node loads.
# - `make session` does all of this with the nodes, on an emulated machine with a driver and a
#   tracker.
