"""Recordings of an arm: rosbag2 and CSV files, filters, and checks of what they hold."""

from dvrk_gravity.recording.bag import BagReader, is_bag
from dvrk_gravity.recording.bag_writer import BagWriter
from dvrk_gravity.recording.checks import check, check_counts
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning, brief
from dvrk_gravity.recording.excerpt import Excerpt, excerpt
from dvrk_gravity.recording.files import is_recording, save_recording
from dvrk_gravity.recording.filters import LowPass, derivative, lowpass
from dvrk_gravity.recording.joint_states import JointStateSample, read_joint_states
from dvrk_gravity.recording.notes import Note
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
    "Note",
    "Prepared",
    "Recording",
    "RecordingFile",
    "Segment",
    "Stretch",
    "Trajectory",
    "brief",
    "check",
    "check_counts",
    "derivative",
    "excerpt",
    "is_bag",
    "is_recording",
    "iterate_recording",
    "lowpass",
    "opened",
    "prepare",
    "read_joint_states",
    "read_trajectory",
    "save_recording",
]
