"""`python -m plumbline_client`: the command."""

import sys

from .cli.main import main

sys.exit(main())
