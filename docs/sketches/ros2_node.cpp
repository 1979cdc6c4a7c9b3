// Displacements in, forces out: NaN where the estimate is not worth having.
// sponge.h: hysid export out/sponge --c sponge.h --float

#include <cmath>
#include <memory>

#include <rclcpp/rclcpp.hpp>
#include <std_msgs/msg/float32.hpp>

#include "sponge.h"

class Compensator : public rclcpp::Node
{
public:
    Compensator() : Node("compensator")
    {
        sponge_reset(&state_);
        forces_ = create_publisher<std_msgs::msg::Float32>("force", 10);
        displacements_ = create_subscription<std_msgs::msg::Float32>(
            "displacement", 10, [this](const std_msgs::msg::Float32 &reading) { step(reading); });
    }

private:
    void step(const std_msgs::msg::Float32 &reading)
    {
        std_msgs::msg::Float32 force;
        int status = sponge_step(&state_, reading.data, &force.data, nullptr);
        if (status == SPONGE_INVALID || status == SPONGE_SATURATED) {
            force.data = NAN;
        }
        forces_->publish(force);
    }

    sponge_state state_;
    rclcpp::Publisher<std_msgs::msg::Float32>::SharedPtr forces_;
    rclcpp::Subscription<std_msgs::msg::Float32>::SharedPtr displacements_;
};

int main(int argc, char **argv)
{
    rclcpp::init(argc, argv);
    rclcpp::spin(std::make_shared<Compensator>());
    rclcpp::shutdown();
    return 0;
}
