from .attempt import Attempt as Attempt
from .stage import Stage as Stage
from .stage import StoreError as StoreError
from .store import Store as Store
