"""One file per node, each thin: parameters and messages in, core calls, messages out."""
