"""A session of the official zaber-motion library with an emulated chain; run as a process.

Its shared library may end the whole process on surprises, so the test keeps it out of its own.
Prints one JSON line with what the library saw.
"""

import json
import sys

from zaber_motion import CommandFailedException, Library, MovementFailedException
from zaber_motion.ascii import Connection

Library.disable_device_db_store()
seen = {}
with Connection.open_serial_port(sys.argv[1]) as connection:
    seen['count'] = len(connection.detect_devices(identify_devices=False))
    first = connection.get_device(1)
    second = connection.get_device(2)
    x, y = first.get_axis(1), second.get_axis(1)
    seen['homed_before'] = x.is_homed()
    x.home()
    y.home()
    seen['homed_after'] = x.is_homed()
    x.move_absolute(20000)
    y.move_relative(1500)
    seen['positions'] = [x.get_position(), y.get_position()]
    x.move_velocity(50000)
    seen['busy'] = x.is_busy()
    x.stop()
    seen['flags_after_stop'] = sorted(x.warnings.get_flags())
    seen['echo'] = first.generic_command('tools echo ' + ' '.join(['word'] * 30)).data
    seen['serial'] = second.settings.get('system.serial')
    try:
        x.move_absolute(99_999_999)
    except CommandFailedException as error:
        seen['rejected'] = error.details.response_data
    connection.checksum_enabled = False
    seen['version'] = first.settings.get_string('version')
    first.settings.set('comm.alert', 1)
    x.move_absolute(0)
    first.generic_command('driver disable', axis=1)
    try:
        x.move_absolute(1000)
    except (CommandFailedException, MovementFailedException) as error:
        seen['disabled'] = type(error).__name__
    first.generic_command('driver enable', axis=1)
    connection.renumber_devices(first_address=3)
    seen['renumbered'] = connection.get_device(4).settings.get('comm.address')
print(json.dumps(seen))
