// The message as ROS 2 makes it, as far as the node in docs/ uses it.
#pragma once

namespace std_msgs::msg
{
struct Float32 {
    float data;
};
}  // namespace std_msgs::msg
