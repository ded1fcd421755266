"""First-order information: saltation, Bouligand derivatives, and what they say of smoothness."""

from hopdata.hybrid.first_order.bouligand import BouligandDerivative, bouligand_derivative
from hopdata.hybrid.first_order.orders import CrossingOrder
from hopdata.hybrid.first_order.saltation import (
    NotTransversalError,
    saltation_matrix,
    saltation_product,
)
from hopdata.hybrid.first_order.section import project_onto_section
from hopdata.hybrid.first_order.selection import EventSelection, check_event_selected
from hopdata.hybrid.first_order.smoothness import SmoothnessReport, check_c1

__all__ = [
    "BouligandDerivative",
    "CrossingOrder",
    "EventSelection",
    "NotTransversalError",
    "SmoothnessReport",
    "bouligand_derivative",
    "check_c1",
    "check_event_selected",
    "project_onto_section",
    "saltation_matrix",
    "saltation_product",
]
