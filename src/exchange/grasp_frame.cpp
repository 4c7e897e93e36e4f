#include "exchange/grasp_frame.h"

namespace handhold {

Eigen::Isometry3d framePose(const Hand& hand, const Eigen::VectorXd& jointPosition, GraspFrame frame, RootAxes axes) {
  const auto X_HL = forwardKinematics(hand, jointPosition);
  Eigen::Isometry3d X_HF = Eigen::Isometry3d::Identity();
  if (frame == GraspFrame::tcp || axes == RootAxes::palm)
    X_HF.linear() = X_HL[static_cast<std::size_t>(hand.palmLink)].linear() * hand.X_LG.linear();
  if (frame == GraspFrame::tcp) X_HF.translation() = X_HL[static_cast<std::size_t>(hand.tcpLink)] * hand.p_LT;
  return X_HF;
}

std::string frameName(const Hand& hand, GraspFrame frame) {
  return frame == GraspFrame::tcp ? "tcp" : hand.links[0].name;
}

}  // namespace handhold
