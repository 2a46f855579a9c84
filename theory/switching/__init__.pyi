"""The theorem families of this room, imported when they are first asked for: `lazy_loader` reads this file."""

from . import double_clock as double_clock
from . import gain as gain
from . import markov as markov
from . import observer as observer
from . import output_feedback as output_feedback
from . import reach as reach
from . import stability as stability
from . import synthesis as synthesis
from . import varying as varying
