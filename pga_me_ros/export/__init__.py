"""Repertoires and controllers in formats of other programs; ONNX and TorchScript need those, nothing needs ROS."""
