from .export import SUFFIXES as SUFFIXES
from .export import ExportResult as ExportResult
from .export import export_model as export_model
from .form import OmittedTorque as OmittedTorque
from .formats import Format as Format
