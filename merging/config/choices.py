"""The methods, descriptors and rules that a user may choose by name."""

from typing import Literal

Method = Literal["correlation", "features", "birk-carpin", "carpin", "li", "saeedi", "trehard", "dobrokhvalov-filatov"]
Descriptor = Literal["concatenated", "and", "or", "xor", "pignistic"]
Rule = Literal[
    "disjunctive",
    "conjunctive",
    "dempster",
    "dubois-prade",
    "yager",
    "average",
    "unanimous",
    "log-odds",
    "entropy-filter",
]
Coverage = Literal["union", "overlap"]
