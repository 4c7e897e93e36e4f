// The online planner as a library: ranks, plans, moves an obstacle, asks again.
// Usage: planner_example ROBOT DB SCENE.yaml OBSTACLE
#include "plan/planner.h"

#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc != 5) return 2;
  try {
    handhold::Planner planner(argv[2], handhold::loadRobot(argv[1]));
    planner.loadScene(argv[3]);
    const handhold::Ranking ranking = planner.rank(handhold::ScoreKind::reach);
    std::printf("%zu grasps, the best scores %.3f\n", ranking.grasps.size(), ranking.grasps.at(0).score.score);

    handhold::PlanRequest request;
    request.score = handhold::ScoreKind::reach;
    const handhold::PlanResult first = planner.plan(request);
    if (!first.planned) return std::printf("%s\n", first.reason.c_str()), 1;
    std::printf("grasp %u, %.2f s\n", first.grasp.score.grasp, first.trajectory.points.back().time);

    handhold::Scene scene = planner.scene();
    for (handhold::Obstacle& obstacle : scene.obstacles) {
      if (obstacle.name == argv[4]) obstacle.X_WS.translation().y() += 0.02;
    }
    planner.setScene(scene);
    request.prefer = first.grasp.score.grasp;  // keep it unless another is clearly better
    const handhold::PlanResult second = planner.plan(request);
    return std::printf("grasp %u\n", second.grasp.score.grasp), second.planned ? 0 : 1;
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "%s\n", error.what()), 2;
  }
}
