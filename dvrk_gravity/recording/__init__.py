"""Recordings of an arm: rosbag2 and CSV files, filters, and checks of what they hold."""

from dvrk_gravity.recording.bag import BagReader
from dvrk_gravity.recording.bag_writer import BagWriter
from dvrk_gravity.recording.checks import check
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning, brief
from dvrk_gravity.recording.excerpt import Excerpt, excerpt
from dvrk_gravity.recording.files import save_recording
from dvrk_gravity.recording.filters import LowPass, derivative, lowpass
from dvrk_gravity.recording.joint_states import JointStateSample, read_joint_states
from dvrk_gravity.recording.prepare import Prepared, Segment, prepare
from dvrk_gravity.recording.stream import (
    Given,
    RecordingFile,
    iterate_recording,
    opened,
)
from dvrk_gravity.recording.trajectory import Stretch, Trajectory, read_trajectory

__all__ = [
    "BagReader",
    "BagWriter",
    "DataWarning",
    "Excerpt",
    "Given",
    "JointStateSample",
    "LowPass",
    "Prepared",
    "Recording",
    "RecordingFile",
    "Segment",
    "Stretch",
    "Trajectory",
    "brief",
    "check",
    "derivative",
    "excerpt",
    "iterate_recording",
    "lowpass",
    "opened",
    "prepare",
    "read_joint_states",
    "read_trajectory",
    "save_recording",
]
