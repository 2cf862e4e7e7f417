"""Prints the thresholds of a page of docs/concepts: `python tools/thresholds.py law`."""

from __future__ import annotations

import re
import sys

from calibrator import online, outliers, places, prepare, temperatures, thermal, training
from calibrator.models import domain, selection
from gap_diagnosis import passes
from gap_diagnosis.closed_loop import (
    axis_loop,
    creep,
    held_out,
    misread,
    polish,
    replay,
    rests,
    slides,
    swing,
)
from gap_diagnosis.evidence import acceptance, judgement, left_out
from gap_diagnosis.experiment import library, motions, propose, scene, separation
from gap_diagnosis.input import checks, coarse, driven_wave, grid, rest_places, windows
from gap_diagnosis.law import judged, search
from gap_diagnosis.residuals import (
    commands,
    controller,
    force_rows,
    foreseen,
    kinematics,
    unrecorded,
)
from gap_diagnosis.selection import (
    forward,
    imitations,
    pairs,
    rivals,
    servo_part,
    shape,
    slow_rows,
    swinging,
    told,
    trials,
)
from stage_core import clocks
from stage_driver import inbox_backend, servo_clocks
from stage_twin import loops, machine
from stage_twin.effects import drive_play, force_saturation, knots, periodic, shared, straightness
from stage_twin.emulators import drive

MODULES = {
    module.__name__.rpartition('.')[2]: module
    for module in (acceptance, axis_loop, checks, clocks, coarse, commands, controller, creep,
                   domain, drive, drive_play, driven_wave, force_rows, force_saturation, foreseen,
                   forward, grid, held_out, imitations, inbox_backend, judged, judgement,
                   kinematics, knots, left_out, library, loops, machine, misread, motions,
                   online, outliers, pairs, passes, periodic, places, polish,
                   prepare, propose, replay, rest_places, rests, rivals, scene, search,
                   selection, separation, servo_clocks, servo_part, shape, shared, slides,
                   slow_rows, straightness, swing, swinging, temperatures, thermal, told, training,
                   trials, unrecorded, windows)
}  # fmt: skip
TABLES = {
    'calibration': """
share of the places that a model is trained on | {prepare.SHARE:.0%}
held-out places below which each is held out once | {prepare.FEWEST_HELD}
rests, at least | {prepare.ENOUGH_RESTS}
distinct places, at least | {prepare.FEWEST_PLACES}
sample that is left out: off a smooth map by | {outliers.WILD:g} robust deviations
the same: share of all samples, at most | {outliers.MOST_WILD:.0%}
left-out RMS of a more complex candidate, at most | {selection.EARNED:.0%} of the simpler one's
reach of a place | {domain.REACH:g} distances of neighbouring places
prediction, at most | {domain.MOST_ERROR:g} × the largest error seen
place that counts as visited again, within | {places.REVISIT:.0%} of the distance of neighbours
adaptation: rests that have to prove it | {online.PROOF}
adaptation: one rest is held out of | {online.JUDGED_EVERY}
adaptation: held-out rests that decide | {online.WINDOW}
adaptation: rolled back if worse by | {online.WORSE:g} ×
the same at two held-out rests | {online.FAR_WORSE:g} ×
adaptation: a rest is refused, off by | {online.GATE:g} × the held-out ones
change of a temperature that is read | {training.LEAST_WARMING:g} K
length of the parabola of `thermal` | {thermal.DERIVATIVE_SPAN:g} s
silence of a temperature sensor | {temperatures.STALE:g} s
""",
    'time': """
wait of the plant for a late force, at most | {loops.PATIENCE:g} s
of which it catches up at most | {drive.Pacer.longest_lag:g} s
time without a force after which the emulated drive brakes | {machine.BRAKING_TIME:g} s
lateness of drive or driver that ends a motion | {servo_clocks.LATE_LIMIT:g} s
pause after which a stream may go on that somebody has stopped | {inbox_backend.ASKED_PAUSE:g} s
lockstep: simulated time of a command line to a Zaber chain | {clocks.LOCKSTEP_EXCHANGE:,} ns
""",
    'diagnosis': """
shortest record | {checks.SHORTEST:g} s
shortest session | {checks.MINIMUM_DURATION:g} s
an axis rests within, steps of its encoder | {checks.RESTS_WITHIN:g}
tracker that stands while the encoder moves, from | {checks.STANDSTILL:g} s
lost ticks in a row around which nothing is judged, more than | {grid.LONG}
error of the tracker's clock, at most | {coarse.LARGEST_LAG:g} s
tracker points that are moved back: turn of their frame, from | {coarse.LEAST_ANGLE:g} rad
the same: offset of their frame, from | {coarse.LEAST_OFFSET:g} m
the same: delay, or that of a drift at the ends, from | {coarse.LEAST_LAG:g} s
what is left then of what is left else, at most | {coarse.CLEARLY:.0%}
start of a held-out session that is not scored | {windows.PREFIX:.0%}
places of a stepper's axis that are one, within | {rest_places.ONE_PLACE:.0%} of its travel
places from which on all effects of such an axis show | {rest_places.ENOUGH}
shortest period that is looked for, travel over | {periodic.PERIODS}
the same of a force ripple, lead over | {periodic.ORDERS}
squared gap of an encoder in the held-out windows, at least | {held_out.LEAST_HELD:.0%}
the same, at most | {held_out.MOST_HELD:.0%}
change of a screw temperature, at least | {kinematics.TEMPERATURE_SPAN:g} K
shrinkage of the gap by a servo effect, at least | {acceptance.LEAST_SHRINK:.0%}
deviations of a searched ripple or from stated values, at least | {acceptance.LARGEST_OF_MANY:g}
squared gap that a servo effect closes, at least | {acceptance.LEAST_CLOSED:.0%}
squared noise that any other effect closes, at least | {acceptance.LEAST_SEEN:.0%}
gap that is `unknown` if nothing is named, from | {acceptance.FAR:g} floors
gap that is `unknown` beside a name or a stated friction, from | {acceptance.FAR_BESIDE:g} floors
the same: squared gap that the effects leave, from | {acceptance.SHARE_BESIDE:.0%}
moved one way after which an axis slides: preslidings, more than | {slides.LEFT_BEHIND:g}
and then time constants of its loop, more than | {slides.SETTLED:g}
the same: its speed, from | {slides.SLOW:.0%} of the fastest
ticks from which on a stated friction is told where it slides | {slides.ENOUGH:.0%}
what the wave of a force leaves of one that is read, at least | {driven_wave.RATHER:g} times
squared encoder gap that a misread wave closes, at least | {misread.CLOSES:.0%}
force balance that a swinging play explains, at least | {swinging.EXPLAINS:.0%}
the same of what the loop cannot tell, at least | {swing.LEAST_SHARE:.0%}
ratio of the swings of twin and record, at most | {swing.AS_MUCH:g}
remainder over the noise from which a swing is looked for, squares | {swinging.FAST:g}
share of it that one sine explains, from which on no loop swings | {swinging.STEADY:.0%}
time constant of the edge of a play before the encoder, below | {drive_play.SLOWEST:g} s
the same: its damping ratio, above | {drive_play.LIVELIEST:g}
increments of a noisy effort at a limit that the law leaves, at least | {commands.HELD:.1f} times
the same of an effort whose noise is its own, at least | {commands.STANDS:.0f} times
what an effect explains that an alternative explains, at least | {rivals.LEAST_OF_ITS_GAIN:.0%}
gap of a far loop beside which an alternative's takes its place, at most | {told.MUCH_CLOSER:.0%}
gap in the loop beside which a richer alternative takes its place, at most | {told.RICHER:.0%}
force balance that is left, over what others left that the loop refuted | {left_out.FAR_MORE:g}
probability from which on an effect is named beside an `unknown` | {left_out.LIKELY:g}
loop's gap that a friction which hunts leaves, at least | {servo_part.HUNTS:.0%}
force that a limit leaves, over what accelerates the mass, at least | {force_saturation.ENOUGH:g}
what is left of a balance that decides for a loop, at most | {servo_part.EXPLAINED:g} noises
rows of a force balance in a period of its cut, at least | {force_rows.IN_A_PERIOD:g}
rows of a balance of which some were left out, at least | {force_rows.ENOUGH}
variances of slow and fast rows from which they are weighted, ratio | {slow_rows.UNEQUAL:g}
draws of the noise of a loop that sticks | {replay.DRAWS}
noise below the steps of an encoder that is tried, over that of rounding | {rests.HIDDEN:.0%}
gap that another way to rest leaves, at most | {rests.CLOSER:.0%}
gap that a friction which gives way leaves, at most | {creep.MUCH_CLOSER:.0%}
share of models that may stay structured | {judgement.SERVO_STRUCTURE:.0%}
gap of an encoder from which an effect is lacking | {axis_loop.FOLLOWS:g} floors
the same: held-out gap that is left with it, at most | {axis_loop.LEFT:.0%}
squared gap above the noise that values of a sliding axis leave, at most | {axis_loop.CLOSER:.0%}
what is left above the noise and an effect that was lacking explains, from | {forward.LACKING:.0%}
what an effect changes where its search starts, of gain or noise, at least | {trials.HOPELESS:.0%}
gap that an effect explains which is impossible alone, and a pair, from | {pairs.NEARLY_ALL:.0%}
loop's gap that a refinement leaves where the balance was wrong, at most | {polish.MUCH_BETTER:.0%}
mean square curvature of a guide, beside that of what it leaves | {shared.ROUGH:g} times
the same for the slope of a reference line | {straightness.LINE:g} times
the same for a force or a friction along the travel | {knots.STIFF:g} times
squares that a curve leaves where it was fitted if it is believed | {foreseen.BELIEVED:g} noises
noise that a balance may lose by the tracker's shape, at most | {shape.LOST:.0%}
what a general curve explains better than a friction, from | {imitations.UNEXHAUSTED[servo]:.0%}
what it explains better than the tracker's clock, from | {imitations.UNEXHAUSTED[sensor]:.0%}
what the encoder's noise makes of a resonance that a tracker shows, at most | {imitations.MADE:.0%}
difference of velocity gain over mass, at most | {passes.SAME_GAIN:.0%}
what other gains leave of what the twin's law leaves, at most | {controller.PARTLY:.0%}
what the law of a controller leaves that read the record, at most | {controller.READ:.0%} of noise
without forces: gains are fitted below | {unrecorded.CALM:g} Hz
without forces: the law is judged below | {unrecorded.CUT:g} Hz
without forces: rows left out around a reversal | {unrecorded.AROUND:g} s
without forces: what a law leaves, at most | {unrecorded.AT_NOISE:g} × noise
the same on rows that slide | {unrecorded.WHILE_SLIDING:g} × noise
without forces: difference of both position gains, at most | {unrecorded.FOLLOWED:.0%}
""",
    'law': """
interval of the gain of a term | {search.LEVEL:.1%}
share of what is left that a term takes, at least | {search.OF_REST:.0%}
squares of the noise, over the number of rows, that a term takes, at least | {search.OF_NOISE:g}
share of the largest gain from which fewer numbers win | {search.ABOUT_THE_SAME:.0%}
share of the mean square that a law explains, at least | {judged.LEAST:.0%}
mean square by which a curve beats a law, at least | {judged.LEAST:.0%}
""",
    'experiment': """
speed, at most | {motions.Limits.speed:g} m/s
acceleration, at most | {motions.Limits.acceleration:g} m/s²
share of the force limit, at most | {scene.SHARE_OF_FORCE:.0%}
duration of one motion | {scene.PIECE:g} s
share of the mean square of the noise, added to the next one | {separation.OF_NOISE:.0%}
share of what the effects explain | {separation.OF_GAP:.2%}
the same for the library: of the noise | {acceptance.LEAST_SEEN:.0%}
the same for the library: of what the effect does | {library.ALIKE:.1%}
share of the library that only bold strokes show, before that is asked | {library.MUCH:.0%}
duration of the session that is simulated with the library | {propose.LONGEST:g} s
""",
}

if __name__ == '__main__':
    print('| threshold | value | in the code |\n|---|---|---|')
    for row in TABLES[sys.argv[1]].strip().splitlines():
        place = re.findall(r'\{([\w.]+)', row)[0]
        print(f'| {row.format(**MODULES).replace("%", " %")} | `{place}` |')
