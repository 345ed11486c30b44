"""One file per node, each thin: parameters and messages in, core calls, messages out."""

from pga_me_ros.ros.parent_watch import watch_parent

# Here, and not where a node starts: its module first imports libraries, and those of the critics take seconds.
watch_parent()
