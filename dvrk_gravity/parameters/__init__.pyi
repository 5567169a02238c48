from .nodes import FRICTION_RATIO as FRICTION_RATIO
from .nodes import node_parameters as node_parameters
from .parameter import Parameter as Parameter
from .parameter import Value as Value
from .parameter import check_all as check_all
from .parameter import flatten as flatten
from .parameter import is_finite as is_finite
from .parameter import unflatten as unflatten
