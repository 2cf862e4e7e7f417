"""Parameters of the node `tracker_bridge`."""

from stage_core.parameters import Parameter
from tracker_bridge.bridge import Limits
from tracker_bridge.rest import RestRules

PARAMETERS = (
    Parameter(
        'source',
        'emscon',
        'where points come from: TPI over TCP, SpatialAnalyzer datagrams, or a session bag',
        choices=('emscon', 'sa_text', 'replay'),
        read_only=True,
    ),
    Parameter(
        'host',
        '127.0.0.1',
        "emscon: the tracker controller's address; sa_text: address of this machine to listen on",
        read_only=True,
    ),
    Parameter(
        'port',
        20700,
        'TCP port of TPI (700 on a tracker), or UDP port to listen on',
        '',
        1,
        65535,
        read_only=True,
    ),
    Parameter(
        'source_clock',
        'own',
        'own: one constant offset is estimated over two seconds; ros: stamps are ROS time',
        choices=('own', 'ros'),
        read_only=True,
    ),
    Parameter(
        'rate',
        100.0,
        'points per second asked for and expected; 0: any',
        'Hz',
        0.0,
        1000.0,
        read_only=True,
    ),
    Parameter('bag', '', 'replay: session folder', read_only=True),
    Parameter(
        'replay_rate',
        1.0,
        'replay: factor on the pace; 0: as fast as possible',
        '',
        0.0,
        1000.0,
        read_only=True,
    ),
    Parameter(
        'sa.labels', ['X', 'Y', 'Z'], 'sa_text: labels of x, y, z, matched exactly', read_only=True
    ),
    Parameter('sa.decimal_comma', False, 'sa_text: numbers are written 3744,50', read_only=True),
    Parameter(
        'sa.unit',
        'mm',
        'sa_text: unit where a datagram names none; empty: refuse it',
        read_only=True,
    ),
    Parameter('limits.gap', Limits.gap, 'longest time between points', 's', 0.0, read_only=True),
    Parameter(
        'limits.age',
        Limits.age,
        'oldest point on arrival, longest silence',
        's',
        0.0,
        read_only=True,
    ),
    Parameter('limits.jump', Limits.jump, 'largest leap between points', 'm', 0.0, read_only=True),
    Parameter(
        'limits.identical',
        Limits.identical,
        'longest run of identical points',
        '',
        1,
        read_only=True,
    ),
    Parameter(
        'limits.quantum', Limits.quantum, 'sa_text: coarsest display', 'm', 0.0, read_only=True
    ),
    Parameter(
        'rest.tolerance',
        RestRules.tolerance,
        'encoder movement within a rest',
        'm',
        0.0,
        1e-3,
        read_only=True,
    ),
    Parameter(
        'rest.shortest',
        RestRules.shortest,
        'least length of a rest',
        's',
        0.0,
        60.0,
        read_only=True,
    ),
    Parameter(
        'rest.settle',
        RestRules.settle,
        'part at the beginning that is not used',
        's',
        0.0,
        60.0,
        read_only=True,
    ),
    Parameter(
        'rest.guard',
        RestRules.guard,
        'part at the end that is not used',
        's',
        0.0,
        60.0,
        read_only=True,
    ),
    Parameter(
        'rest.longest',
        RestRules.longest,
        'a longer rest is used up to here',
        's',
        0.1,
        60.0,
        read_only=True,
    ),
)
