"""Rules by which the beliefs of any number of sources about a cell become one.

Every rule here takes its sources in any order: those that are not associative in pairs (Dubois and Prade, Yager, the
average) are computed for all sources at once, from sums and products that can be kept as sources come. The rules of
programs that hold no masses read a belief as its pignistic probability, and give back the least committed belief with
the probability that they come to.
"""

from typing import NamedTuple

from merging.config.choices import Rule
from tbmslam.kernels.grids import fusion


class FusionRule(NamedTuple):
    """How the kernel fuses.

    Parameters
    ----------
    code
        Which of the kernel's rules it is.
    width
        Numbers kept of each cell until all sources have spoken.
    """

    code: int
    width: int


RULES: dict[Rule, FusionRule] = {
    # At least one source is right: disagreement becomes ignorance (the paper's eq. 6; Smets 1993).
    "disjunctive": FusionRule(fusion.DISJUNCTIVE, 4),
    # All are right: agreement sharpens, disagreement stays as conflict (the paper's eq. 5; Smets 1990).
    "conjunctive": FusionRule(fusion.CONJUNCTIVE, 4),
    # The same, the conflict shared out among the rest (Shafer 1976).
    "dempster": FusionRule(fusion.DEMPSTER, 4),
    # What the sources have in common, and where that is nothing, what any of them holds (Dubois and Prade 1988).
    "dubois-prade": FusionRule(fusion.DUBOIS_PRADE, 10),
    # What they have in common; all conflict becomes ignorance (Yager 1987).
    "yager": FusionRule(fusion.YAGER, 4),
    # The mean of the masses (Howard 2006; Li, Hao et al. average probabilities likewise).
    "average": FusionRule(fusion.AVERAGE, 4),
    # Cells are free, occupied or unknown; where sources differ nothing is known (Birk and Carpin 2006). Where only one
    # takes a side, its belief stays.
    "unanimous": FusionRule(fusion.UNANIMOUS, 6),
    # Sources are independent: log odds add up (Saeedi et al. 2012; Moravec 1988).
    "log-odds": FusionRule(fusion.LOG_ODDS, 6),
    # The same, but a sum less certain than its surest source is rejected and that source believed (Saeedi et al.
    # compare with the first map; the surest one makes the order of the maps not matter).
    "entropy-filter": FusionRule(fusion.ENTROPY_FILTER, 6),
}
