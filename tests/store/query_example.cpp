// The best grasps of every mug that approach along +x and aim at a point near its rim: query_example DIR
#include "core/error.h"
#include "store/database.h"

#include <iostream>
#include <numbers>

int main(int argc, char** argv) try {
  const handhold::Database database(argc > 1 ? argv[1] : "db");
  handhold::GraspQuery query;
  query.object = "mug*";
  query.approach = {{1, 0, 0}, 75 * std::numbers::pi / 180};  // direction, half angle
  query.near = {{0, 0, 0.08}, 0.05};                          // centre, radius [m]
  query.top = 3;
  const handhold::QueryAnswer answer = database.query(query);
  for (const std::string& failure : answer.failures) std::cerr << failure << '\n';
  for (const handhold::FoundSet& set : answer.sets) {
    for (const handhold::FoundGrasp& grasp : set.grasps) {
      std::cout << set.object << ' ' << set.hand << " grasp " << grasp.grasp << " epsilon " << grasp.epsilon << '\n'
                << grasp.X_OH.matrix() << '\n';  // the hand's root link in the object frame
    }
  }
} catch (const handhold::InputError& error) {
  std::cerr << error.what() << '\n';
  return 2;
}
