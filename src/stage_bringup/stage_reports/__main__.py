"""``python -m stage_reports --bag BAG --out DIR``, as ``ros2 run stage_reports report``."""

import sys

from stage_reports.command import main

sys.exit(main())
