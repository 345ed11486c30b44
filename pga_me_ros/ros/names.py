"""Names of the graph's topics and services: relative, so that they remap and nest in a namespace."""

from __future__ import annotations

GET_BEHAVIOR = "repertoire/get_behavior"
GET_BEHAVIORS = "repertoire/get_behaviors"
LIST_BEHAVIORS = "repertoire/list_behaviors"
LIST_GENERATIONS = "repertoire/list_generations"
GET_INFO = "repertoire/get_info"
GET_ACTOR = "repertoire/get_actor"
METRICS = "repertoire/metrics"
HEATMAP = "repertoire/heatmap"
GRID = "repertoire/grid"

START_ADAPTATION = "adapt/start"
NEXT_TRIAL = "adapt/next"
REPORT_TRIAL = "adapt/report"
ADAPTATION_STATUS = "adapt/status"
ADAPTATION = "adapt/estimate"

TRANSITIONS = "experience/transitions"
SNAPSHOT = "critic/snapshot"
ELITES = "archive/elites"
PROGRESS = "progress"
STATUS = "status"
DIAGNOSTICS = "/diagnostics"
"""Absolute by convention: monitors subscribe there, and entries carry full names."""

EVALUATE = "~/evaluate"
ADD_TO_ARCHIVE = "archive/add"
SAMPLE_PARENTS = "archive/sample_parents"
EXTRACT = "archive/extract"
TRAIN = "critic/train"
STORE_EXPERIENCE = "critic/store_experience"
PROPOSE = "variation/propose"

PAUSE = "~/pause"
RESUME = "~/resume"
STOP = "~/stop"
EMERGENCY_STOP = "~/emergency_stop"

JOINT_STATES = "joint_states"
ODOMETRY = "odom"
ROBOT_DESCRIPTION = "robot_description"
IMU = "imu"
CONTACTS = "contacts"
COMMANDS = "commands"

# Absolute, because tools look for these at the root, whatever the namespace.
TF = "/tf"
TF_STATIC = "/tf_static"
CLOCK = "/clock"
