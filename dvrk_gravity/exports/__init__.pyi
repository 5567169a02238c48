from .export import SUFFIXES as SUFFIXES
from .export import Exported as Exported
from .export import export_model as export_model
from .form import Format as Format
from .form import LeftOut as LeftOut
