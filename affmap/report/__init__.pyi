from .build import Report as Report
from .build import check as check
from .build import write as write
from .experiment import ExperimentReport as ExperimentReport
