"""One file per node, each thin: parameters and messages in, core calls, messages out."""

from pga_me_ros.process.parent_watch import watch_parent
from pga_me_ros.process.streams import open_standard_streams

open_standard_streams()
# Done here and not where a node starts: its module first imports libraries, and those of the critics take seconds.
watch_parent()
