"""The MTM's tree under the names that it had."""

from dvrk_gravity.arms.mtm.beta import beta_tree
from dvrk_gravity.arms.mtm.gravity import LINKS
from dvrk_gravity.arms.mtm.parallelogram import BODIES as TREE_LINKS
from dvrk_gravity.arms.tree import Tree, build_tree, link_frames

__all__ = ["LINKS", "TREE_LINKS", "Tree", "beta_tree", "build_tree", "link_frames"]
