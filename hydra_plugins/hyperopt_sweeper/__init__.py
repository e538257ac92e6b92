"""A Hydra sweeper that searches with hyperopt: `app -m hydra/sweeper=hyperopt 'lr=interval(0,1)'`.

Any Hydra application can use it; it knows none. `hyperopt_sweeper` is the plugin. The names of the other modules begin
with `_` so that Hydra does not scan them whenever an application starts: `_space` is Hydra's grammar, `_search` is all
of hyperopt, `_outcomes` reads the return values of jobs, `_trials` the files on disk.
"""

from hydra_plugins.hyperopt_sweeper._outcomes import FinalError as FinalError
from hydra_plugins.hyperopt_sweeper._space import SearchError as SearchError
from hydra_plugins.hyperopt_sweeper._space import TrialError as TrialError
from hydra_plugins.hyperopt_sweeper._trials import TRIALS as TRIALS
from hydra_plugins.hyperopt_sweeper._trials import read as read_trials
from hydra_plugins.hyperopt_sweeper._trials import table as trials_table

__all__ = ["TRIALS", "FinalError", "SearchError", "TrialError", "read_trials", "trials_table"]
