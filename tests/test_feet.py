from hopdata.feet import foot_called, foot_names, with_foot_names


def test_the_contact_columns_name_the_feet_in_their_order():
    columns = ["t_pre_s", "contact_R_heel_s", "contact_a b_s", "se_R_heel_s"]
    assert foot_names(columns) == ("R_heel", "a b")
    assert foot_names(["schedule"]) == ()


def test_an_order_is_named_only_if_each_foot_has_a_name():
    assert with_foot_names("2>1", ("toe", "heel")) == "heel → toe"
    assert with_foot_names("3>1", ("toe", "heel")) == "3 → 1"
    assert with_foot_names("1>2, 4>3", ("a", "b", "c", "d")) == "a → b, d → c"
    assert with_foot_names("others", ("toe",)) == "others"
    assert foot_called(2, ("toe", "heel")) == "heel"
    assert foot_called("3", ("toe", "heel")) == "foot 3"
