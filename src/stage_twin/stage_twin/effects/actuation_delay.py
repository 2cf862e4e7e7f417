"""The force acts later than it is commanded."""

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='actuation_delay',
    link='servo',
    parameters=(Parameter('delay', 's', 0.0, 0.02, 1e-3, "time added to the file's `delay`"),),
    model='The force acts later by a fieldbus cycle, a computation or a filter; exact zero-order '
    'hold with the fraction of a tick. Astrom and Wittenmark, "Computer-controlled systems" '
    '(1997), sampling of systems with time delay.',
    sentence='the force acts {delay} later than the twin says',
    excited_by='a frequency sweep',
    separated_from={
        'structural_resonance': 'a frequency sweep beyond the suspected resonance (to 150 Hz): a '
        'delay turns the phase without a peak of the amplitude',
    },
)
