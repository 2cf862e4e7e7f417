"""Age of a tracker point at its stamp."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='tracker_latency',
    link='sensor',
    parameters=(Parameter('latency', 's', -0.1, 0.1, 2e-3, 'age of a point at its stamp'),),
    model='The point shows the table at stamp - latency. Muralikrishnan, Phillips, Sawyer, "Laser '
    'trackers for large-scale dimensional metrology: a review", Precision Engineering 44 (2016).',
    sentence='a tracker point is {latency} old at its stamp',
    excited_by='fast strokes in both directions',
    per_axis=False,
)
