# find_package(handhold): handhold::plan for the online planner, handhold::store for databases, and what they stand on.
include("${CMAKE_CURRENT_LIST_DIR}/dependencies.cmake")
include("${CMAKE_CURRENT_LIST_DIR}/handholdTargets.cmake")
