"""The user of `test_two_computers.py`, on the computer without the stage; tells in lines."""

from __future__ import annotations

import sys
import threading

from stage_core.errors import StageError

from .rig import PATIENCE, Watch, last, spread


def tell(line: str) -> None:
    """Print a line and wait for one."""
    print(line, flush=True)
    sys.stdin.readline()


def main() -> None:
    """Move, record, lose the cable in a contour, and go on when it is back."""
    watch = Watch(lockstep=False, lean=True)
    watch.wait(lambda: len(watch.encoder) > 100, 'the encoder')
    watch.home()
    client = watch.client
    bag = client.trigger('/session_recorder/start', PATIENCE).split()[-1]
    watch.move(0.01, -0.01)
    watch.wait(watch.arrived(0.01, -0.01), 'a move over the cable')
    answer: list[str] = []

    def follow() -> None:
        try:
            answer.append(client.trigger('/contour_ctrl/run', 2.0 * PATIENCE))
        except StageError as error:
            answer.append(str(error))

    contour = threading.Thread(target=follow, daemon=True)
    contour.start()
    begin = watch.encoder[-1]
    watch.wait(lambda: abs(watch.encoder[-1][1] - begin[1]) > 0.002 or bool(answer), 'motion')
    tell('moving')
    contour.join(2.0 * PATIENCE)
    seen = watch.encoder[-1][0]
    # All of them, not the newest alone: lost ones come late, behind those of before the cut.
    watch.wait(lambda: last(watch.encoder, 200)[0][0] > seen + 10**9, 'the encoder after the cut')
    print(f'rest {spread(last(watch.encoder, 200)):.9f}', flush=True)
    watch.wait(lambda: not watch.text('stage_driver: peers').strip().endswith('again'), 'peers')
    watch.wait(lambda: watch.text('tracker_bridge: connection') == 'connected', 'the tracker')
    watch.home()
    watch.move(-0.01, 0.02)
    watch.wait(watch.arrived(-0.01, 0.02), 'a move after the cut')
    client.trigger('/session_recorder/stop', PATIENCE)
    print(f'contour {answer[0]!r}', flush=True)
    print(f'bag {bag}', flush=True)
    watch.close()


if __name__ == '__main__':
    main()
