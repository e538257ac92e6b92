"""Tables on disk -> statistics, figures and a document. Knows files only: no models, no environment, no torch."""

from affmap.report.document import write
from affmap.report.tables import Job

__all__ = ["Job", "write"]
