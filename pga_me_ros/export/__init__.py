"""Repertoires and controllers in formats of other programs. Needs onnx or torch for those formats, and never ROS."""
