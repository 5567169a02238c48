from .export import SUFFIXES as SUFFIXES
from .export import Exported as Exported
from .export import export_model as export_model
from .form import LeftOut as LeftOut
from .formats import Format as Format
