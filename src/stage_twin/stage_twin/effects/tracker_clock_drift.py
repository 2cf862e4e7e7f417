"""A clock of the tracker that runs fast or slow."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='tracker_clock_drift',
    link='sensor',
    parameters=(Parameter('drift', 's/s', -1e-3, 1e-3, 20e-6, 'stamp = t * (1 + drift)'),),
    model="The tracker's quartz runs fast or slow; zero at the session's start. Mills, "
    '"Computer network time synchronization" (2011), clock frequency error.',
    sentence='the tracker clock runs fast by {drift}',
    excited_by='the same fast stroke at the beginning and at the end of a session of 10 minutes',
    per_axis=False,
    separated_from={
        'tracker_latency': 'the same fast stroke at the beginning and at the end of a session of '
        '10 minutes: a latency stays the same',
    },
)
