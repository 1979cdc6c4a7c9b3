// The message's fields.
#pragma once
#include <cstdint>

namespace geometry_msgs::msg
{
struct WrenchStamped
{
    struct
    {
        struct
        {
            std::int32_t sec = 0;
            std::uint32_t nanosec = 0;
        } stamp;
    } header;
    struct
    {
        struct
        {
            double x = 0, y = 0, z = 0;
        } force, torque;
    } wrench;
};
}  // namespace geometry_msgs::msg
