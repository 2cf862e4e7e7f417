"""The law of the remainder, checked blind."""

import os
from pathlib import Path

# The twin collects its effects when it is imported.
os.environ['STAGE_EFFECTS'] = str(Path(__file__).with_name('planted.py'))
